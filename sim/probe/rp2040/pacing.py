"""Who runs when on an emulated RP2040: the processor's instructions, and between them the state machines.

rp2040py looks at both PIO blocks after every instruction, which takes longer than the instruction. Here each
block has an alarm of its own at the moment when its next instruction is due: on time to the cycle, also while
the processor sleeps. And each access to memory looks the chip's method up, in case it was overridden: found
ready made among its attributes it costs half. Together that makes the emulation three times as fast.
"""

from __future__ import annotations

from typing import Any

from rp2040py.execute_batch import execute_batch
from rp2040py.simulator import Simulator

_NS_A_CYCLE = 8.0
_FRACTIONS = 256  # of a cycle, in the blocks' own reckoning
_LOOK_NS = 4000.0  # between two looks at a block that is off or waits for a queue
_ACCESSES = ("read_uint8", "read_uint16", "read_uint32", "write_uint8", "write_uint16", "write_uint32")
_TOGETHER = 8  # instructions after which the clock goes on: .1 us


class _Block:
    """One PIO block's alarm."""

    def __init__(self, mcu: Any, block: Any) -> None:
        self._clock, self._block = mcu.clock, block
        self._cycle = 0
        self._alarm = mcu.clock.create_alarm(self._due)
        self._alarm.schedule(_LOOK_NS)

    def _due(self) -> None:
        block = self._block
        cycle = round(self._clock.nanos / _NS_A_CYCLE)
        passed, self._cycle = cycle - self._cycle, cycle
        if block.stopped:
            self._alarm.schedule(_LOOK_NS)
            return
        block.advance(passed)
        left = -(-(block.next_due_fp - block.cycle_fp) // _FRACTIONS) * _NS_A_CYCLE
        self._alarm.schedule(min(max(left, _NS_A_CYCLE), _LOOK_NS))


class Pacing(Simulator):
    """Runs a chip.

    The loop of rp2040py takes the chip's list of PIO blocks before it first asks whether it is to stop: it is
    shown none, and everybody else, from then on, finds them where they belong.
    """

    def __init__(self, mcu: Any) -> None:
        super().__init__(rp2040=mcu)
        self._mcu = mcu
        for name in _ACCESSES:
            setattr(mcu, name, getattr(mcu, name))
        self._pio = mcu.pio
        self._blocks = [_Block(mcu, block) for block in mcu.pio]

    def __getattr__(self, name: str) -> Any:
        if name == "stopped":
            self._mcu.pio = self._pio
            self.stopped = False
            return False
        raise AttributeError(name)

    def run(self) -> None:
        """Some milliseconds of the computer's time."""
        vars(self).pop("stopped", None)
        self._mcu.pio = ()
        execute_batch(self, _TOGETHER)

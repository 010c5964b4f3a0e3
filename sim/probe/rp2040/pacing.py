"""Who runs when on an emulated RP2040: the processor's instructions, and between them the state machines.

rp2040py looks at both PIO blocks after every instruction, which takes longer than the instruction. Here each
block has an alarm of its own at the moment when its next instruction is due: on time to the cycle, also while
the processor sleeps. A block that moves no pins (the encoder's) may be some microseconds late; one that is
off is not looked at until its registers are written. And each access to memory looks the chip's method up, in
case it was overridden: found ready made among its attributes it costs half. Together that makes the emulation
three times as fast.
"""

from __future__ import annotations

from typing import Any

from rp2040py.execute_batch import execute_batch
from rp2040py.simulator import Simulator

_NS_A_CYCLE = 8.0
_FRACTIONS = 256  # of a cycle, in the blocks' own reckoning
_LOOK_NS = 4000.0  # between two looks at a block that waits for a queue
_REST_NS = 1e6  # and at one that is off, or whose processor hangs
_LATE_NS = 8000.0  # how late one may be that moves no pins: a turn of the encoder's program
_ACCESSES = ("read_uint8", "read_uint16", "read_uint32", "write_uint8", "write_uint16", "write_uint32")
_TOGETHER = 8  # instructions after which the clock goes on: .1 us


class _Block:
    """One PIO block's alarm; on the bus it stands in the block's place, to see its registers written."""

    def __init__(self, mcu: Any, block: Any) -> None:
        self._clock, self._block = mcu.clock, block
        self._cycle = 0
        self.rests = False
        self._alarm = mcu.clock.create_alarm(self._due)
        self._alarm.schedule(_LOOK_NS)
        self.read_uint32 = block.read_uint32
        for address, peripheral in mcu.peripherals.items():
            if peripheral is block:
                mcu.peripherals[address] = self

    def write_uint32_atomic(self, offset: int, value: int, kind: int) -> None:
        """The bus writes to a register."""
        off = self._block.stopped
        self._block.write_uint32_atomic(offset, value, kind)
        if off:
            self._passed()
            self._alarm.schedule(_NS_A_CYCLE)

    def _passed(self) -> int:
        """Cycles since this was last asked."""
        cycle = round(self._clock.nanos / _NS_A_CYCLE)
        passed, self._cycle = cycle - self._cycle, cycle
        return passed

    def _due(self) -> None:
        block = self._block
        if block.stopped or self.rests:
            self._alarm.schedule(_REST_NS)
            return
        passed = self._passed()
        if not block.pin_directions:
            end = block.cycle_fp + passed * _FRACTIONS
            while (due := block.next_due_fp) <= end:
                block.advance(max(-((block.cycle_fp - due) // _FRACTIONS), 0))
            block.advance((end - block.cycle_fp) // _FRACTIONS)
            self._alarm.schedule(_LATE_NS)
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

    def rest(self, rests: bool) -> None:
        """Whether the state machines are left alone, since nobody hears of what they do."""
        for block in self._blocks:
            block.rests = rests

    def run(self) -> None:
        """Some milliseconds of the computer's time."""
        vars(self).pop("stopped", None)
        self._mcu.pio = ()
        execute_batch(self, _TOGETHER)

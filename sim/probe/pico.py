"""Pins, wheel, UART and state machines of a Pico on a virtual clock, for drivers that run in this process.

`installed` puts them in the place of MicroPython's `machine`, so that firmware_py/boards runs on them
unchanged. The whole board with its interpreter is in palpate.sim.probe.rp2040. Times are in us.
"""

import sys
import time
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from palpate.sim.probe import pio

PIN_CALL_US = 1.2  # what one Pin.value costs the interpreter on an RP2040, about


class Clock:
    """Time in us, moved on by whatever takes time."""

    def __init__(self) -> None:
        self.us = 0.0


class Circuit:
    """What is on the pins."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.pins: dict[object, Pin] = {}
        self.machines: list[pio.StateMachine] = []

    def now_us(self) -> float:
        """The time, for the PIO's machines."""
        return self.clock.us

    def wait_us(self, us: float) -> None:
        """Let time pass."""
        self.clock.us += us

    def levels(self, first: int, n: int) -> int:
        """Levels of n pins from `first` on, the first in bit 0."""
        return sum(self.pin(first + k).level << k for k in range(n))

    def pin(self, name: object) -> "Pin":
        """The pin of that number, made when it is first named."""
        if name not in self.pins:
            self.pins[name] = Pin(self, name)
        return self.pins[name]


class Pin:
    """What machine.Pin(n) gives: one object for each pin of the circuit."""

    IN, OUT, PULL_UP = 0, 1, 2
    IRQ_RISING, IRQ_FALLING = 1, 2

    def __init__(self, circuit: Circuit, name: object) -> None:
        self.name = name
        self.level = 0
        self._circuit = circuit
        self._handler: Callable[[Pin], None] | None = None

    def value(self, level: int | None = None) -> int:
        self._circuit.clock.us += PIN_CALL_US
        if level is not None:
            self.level = level
        return self.level

    def irq(self, handler: Callable[["Pin"], None], trigger: int, hard: bool = False) -> None:
        assert hard, "a soft interrupt would come late"
        self._handler = handler

    def drive(self, level: int, interrupt: bool = True) -> None:
        """Something outside sets this input."""
        changed = level != self.level
        for machine in self._circuit.machines:
            machine.catch_up()
        self.level = level
        if changed and interrupt and self._handler:
            self._handler(self)


class UART:
    """machine.UART: `to_host` is what has left the wire, `from_host` what has arrived."""

    circuit: Circuit

    def __init__(self, _id: int, baudrate: int, txbuf: int = 256, rxbuf: int = 256, **_: object) -> None:
        self._bytes_per_us = baudrate / 10e6
        self._room, self.rxbuf = txbuf, rxbuf
        self._waiting, self.to_host, self.from_host = bytearray(), bytearray(), bytearray()
        self._since = self.circuit.clock.us

    def _carry(self) -> None:
        now = self.circuit.clock.us
        n = min(int((now - self._since) * self._bytes_per_us), len(self._waiting))
        if n:
            self.to_host += self._waiting[:n]
            del self._waiting[:n]
        self._since = now if not self._waiting else self._since + n / self._bytes_per_us

    def any(self) -> int:
        return len(self.from_host)

    def readinto(self, buffer: bytearray) -> int | None:
        n = min(len(buffer), len(self.from_host))
        buffer[:n] = self.from_host[:n]
        del self.from_host[:n]
        return n or None

    def write(self, buffer: bytearray, offset: int = 0, length: int | None = None) -> int | None:
        self._carry()
        end = len(buffer) if length is None else offset + length
        n = min(end - offset, self._room - len(self._waiting))
        self._waiting += buffer[offset : offset + n]
        return n or None


def turn(circuit: Circuit, steps: int, interrupt: bool = True, step_us: float = 12.0) -> None:
    """Turn the encoder's wheel by so many quarter steps, one every `step_us`."""
    a, b = circuit.pin(10), circuit.pin(11)
    cycle = [(0, 0), (1, 0), (1, 1), (0, 1)]
    for _ in range(abs(steps)):
        at = cycle.index((a.level, b.level))
        circuit.wait_us(step_us)
        level_a, level_b = cycle[(at + (1 if steps > 0 else -1)) % 4]
        a.drive(level_a, interrupt)
        b.drive(level_b, interrupt)


def _boards() -> set[str]:
    return {name for name in sys.modules if name.startswith("firmware_py.boards.")}


@contextmanager
def installed(circuit: Circuit) -> Iterator[None]:
    """MicroPython's `machine`, `micropython` and the clock are the circuit's for as long as this lasts."""
    machine, micropython = types.ModuleType("machine"), types.ModuleType("micropython")

    def named(_cls: type, name: object, mode: int = 0, pull: int = 0, value: int | None = None) -> Pin:
        pin = circuit.pin(name)
        if value is not None:
            pin.value(value)
        return pin

    members: dict[str, object] = {
        "Pin": type("Pin", (Pin,), {"__new__": named}),
        "UART": type("UART", (UART,), {"circuit": circuit}),
        "disable_irq": lambda: 0,
        "enable_irq": lambda state: None,
    }
    for name, member in members.items():
        setattr(machine, name, member)
    micropython.kbd_intr = lambda byte: None  # type: ignore[attr-defined]

    def sleep_us(us: int) -> None:
        circuit.clock.us += us

    def ticks_us() -> int:
        return int(circuit.clock.us) & (1 << 30) - 1

    rp2 = types.ModuleType("rp2")
    machine_of_this = type(
        "StateMachine", (pio.StateMachine,), {"board": circuit, "running": circuit.machines}
    )
    for name, member in {
        "asm_pio": pio.asm_pio,
        "PIO": types.SimpleNamespace(SHIFT_LEFT=0, SHIFT_RIGHT=1),
        "StateMachine": machine_of_this,
    }.items():
        setattr(rp2, name, member)
    before = {name: sys.modules.get(name) for name in ("machine", "micropython", "rp2")}
    boards_before = _boards()
    sys.modules.update(machine=machine, micropython=micropython, rp2=rp2)
    time.sleep_us, time.ticks_us = sleep_us, ticks_us  # type: ignore[attr-defined]
    try:
        yield
    finally:
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module
        for name in _boards() - boards_before:  # they hold this board's pins
            delattr(sys.modules["firmware_py.boards"], name.rpartition(".")[2])
            del sys.modules[name]
        del time.sleep_us, time.ticks_us  # type: ignore[attr-defined]

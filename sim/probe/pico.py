"""The reference probe's circuit on a virtual clock: pins, multiplexers, amplifiers, ADCs, encoder, UART.

`install` puts it in the place of MicroPython's `machine`, so that firmware_py/boards runs on it unchanged.
What the parts do, and how long they take, is from their data sheets; times are in us.
"""

import math
import sys
import time
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from sim.probe import pio

PIN_CALL_US = 1.2  # what one Pin.value costs the interpreter on an RP2040, about
MCP3202_MAX_HZ = 1_200_000  # at 3.3 V, between .9 MHz at 2.7 V and 1.8 MHz at 5 V
SELECT_HIGH_US = 0.5  # the MCP3202 wants to be let go so long between two conversions


class Clock:
    """Time in us, moved on by whatever takes time."""

    def __init__(self) -> None:
        self.us = 0.0


class Circuit:
    """Everything on the board. `cells` (16, 26): counts that the sensors would give, settled."""

    def __init__(self, cells: np.ndarray | None = None, settling_us: float = 1.0) -> None:
        self.clock = Clock()
        self.cells = np.zeros((16, 26), dtype=int) if cells is None else cells
        self.displacement_counts = 0
        self.settling_us = settling_us  # time constant of the amplifiers
        self.pins: dict[object, Pin] = {}
        self._levels = {"A": 0.0, "B": 0.0}
        self._targets = {"A": 0.0, "B": 0.0}
        self._changed_us = -1e9
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

    def _address(self, pins: tuple[int, ...]) -> int:
        return sum(self.pin(n).level << bit for bit, n in enumerate(pins))

    def pin_changed(self) -> None:
        """An address may have changed: the amplifiers start towards another cell."""
        for name in ("A", "B"):
            self._levels[name] = self.analogue(name)
        self._changed_us = self.clock.us
        row, column = self._address((2, 3, 4, 5)), self._address((6, 7, 8, 9))
        self._targets["A"] = float(self.cells[row, column])
        self._targets["B"] = float(self.cells[row, 16 + column]) if column < 10 else 0.0

    def analogue(self, name: str) -> float:
        """Output of amplifier A or B now, in counts."""
        target = self._targets[name]
        left = math.exp(-(self.clock.us - self._changed_us) / self.settling_us) if self.settling_us else 0.0
        return target + (self._levels[name] - target) * left


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
        if level is not None and level != self.level:
            self.level = level
            self._circuit.pin_changed()
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


class MCP3202:
    """The converter's side of the bus, bit by bit."""

    def __init__(self, circuit: Circuit, select: int, channels: Callable[[int], float]) -> None:
        self.circuit, self.select, self._channels = circuit, select, channels

    def transfer(self, sent: bytes, baud: int) -> bytes:
        """One selection: the bits that come out while `sent` goes in."""
        assert baud <= MCP3202_MAX_HZ, f"{baud} Hz is too fast for the MCP3202"
        out, config, counting = 0, [], -1
        answer: list[int] = []
        for byte in sent:
            for bit in range(7, -1, -1):
                self.circuit.clock.us += 1e6 / baud
                din, dout = byte >> bit & 1, 1
                if counting < 0:
                    if din:
                        counting = 0
                elif counting < 3:
                    config.append(din)
                    counting += 1
                    if counting == 3:
                        single, channel, msb_first = config
                        assert single and msb_first
                        counts = int(np.clip(round(self._channels(channel)), 0, 4095))
                        answer = [0, *[counts >> k & 1 for k in range(11, -1, -1)]]
                else:
                    dout = answer.pop(0) if answer else 0
                out = out << 1 | dout
        return out.to_bytes(len(sent), "big")


class SPI:
    """machine.SPI."""

    circuit: Circuit
    chips: tuple[MCP3202, ...]

    def __init__(self, _id: int, baudrate: int, sck: Pin, mosi: Pin, miso: Pin) -> None:
        assert (sck.name, mosi.name, miso.name) == (18, 19, 16), "SPI 0 is wired to other pins"
        self._baud = baudrate

    def write_readinto(self, sent: bytes, reply: bytearray) -> None:
        chosen = [chip for chip in self.chips if self.circuit.pin(chip.select).level == 0]
        assert len(chosen) == 1, f"{len(chosen)} chips are selected"
        reply[:] = chosen[0].transfer(bytes(sent), self._baud)


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


def turn(circuit: Circuit, steps: int, interrupt: bool = True, step_us: float = 2.0) -> None:
    """Turn the encoder's wheel by so many quarter steps, one every `step_us`."""
    a, b = circuit.pin(10), circuit.pin(11)
    cycle = [(0, 0), (1, 0), (1, 1), (0, 1)]
    for _ in range(abs(steps)):
        at = cycle.index((a.level, b.level))
        circuit.wait_us(step_us)
        level_a, level_b = cycle[(at + (1 if steps > 0 else -1)) % 4]
        a.drive(level_a, interrupt)
        b.drive(level_b, interrupt)


@contextmanager
def installed(circuit: Circuit) -> Iterator[None]:
    """MicroPython's `machine`, `micropython` and the clock are the circuit's for as long as this lasts."""
    machine, micropython = types.ModuleType("machine"), types.ModuleType("micropython")

    def named(_cls: type, name: object, mode: int = 0, pull: int = 0, value: int | None = None) -> Pin:
        pin = circuit.pin(name)
        if value is not None:
            pin.value(value)
        return pin

    chips = (
        MCP3202(circuit, 17, lambda channel: circuit.analogue("AB"[channel])),
        MCP3202(circuit, 20, lambda channel: float(circuit.displacement_counts)),
    )
    members: dict[str, object] = {
        "Pin": type("Pin", (Pin,), {"__new__": named}),
        "SPI": type("SPI", (SPI,), {"circuit": circuit, "chips": chips}),
        "UART": type("UART", (UART,), {"circuit": circuit}),
        "unique_id": lambda: b"\xe6\x61\x38\x52\x83\x4f\x2b\x2c",
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
        "bootsel_button": lambda: 0,
        "asm_pio": pio.asm_pio,
        "PIO": types.SimpleNamespace(SHIFT_LEFT=0, SHIFT_RIGHT=1),
        "StateMachine": machine_of_this,
    }.items():
        setattr(rp2, name, member)
    before = {name: sys.modules.get(name) for name in ("machine", "micropython", "rp2")}
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
        for name in [n for n in sys.modules if n.startswith("firmware_py.boards.")]:
            delattr(sys.modules["firmware_py.boards"], name.rpartition(".")[2])
            del sys.modules[name]
        del time.sleep_us, time.ticks_us  # type: ignore[attr-defined]

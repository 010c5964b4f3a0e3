"""The RP2040's programmable I/O, cycle by cycle: MicroPython's assembler words, the machine and its queue.

Only what a counting program needs: jmp, in, push, mov, irq, set; anything else is refused. Times in us.
Source: RP2040 Datasheet, chapter 3 (instruction encodings in 3.4); `rp2.asm_pio` of MicroPython's manual.
"""

from __future__ import annotations

import types
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

MEMORY = 32  # instructions of a block
FIFO = 4
LONGEST_WAIT_US = 100.0
_WORD = 0xFFFFFFFF
_PLACES = {"pins": 0, "x": 1, "y": 2, "null": 3, "pc": 5, "isr": 6, "osr": 7}
_CONDITIONS = {"not_x": 1, "x_dec": 2, "not_y": 3, "y_dec": 4, "x_not_y": 5}
_JMP, _IN, _PUSH, _MOV, _IRQ, _SET = 0, 2, 4, 5, 6, 7


class Assembler:
    """Collects instructions as the words of the language are called."""

    def __init__(self) -> None:
        self._code: list[tuple[int, str | None]] = []
        self._labels: dict[str, int] = {}

    def words(self) -> dict[str, Any]:
        """What a program may say."""
        names: dict[str, Any] = {**_PLACES, **_CONDITIONS, "noblock": 1}
        names["invert"] = lambda source: source | 8
        names["rel"] = lambda index: index | 16
        for name in ("jmp", "in_", "push", "mov", "irq", "set", "nop", "label"):
            names[name] = getattr(self, name)
        return names

    def _put(self, code: int, label: str | None = None) -> None:
        self._code.append((code, label))

    def label(self, name: str) -> None:
        if name in self._labels:
            raise ValueError(f"the label {name} stands twice")
        self._labels[name] = len(self._code)

    def jmp(self, condition: int | str, label: str | None = None) -> None:
        if isinstance(condition, str):
            self._put(_JMP << 13, condition)
        else:
            self._put(_JMP << 13 | condition << 5, label)

    def in_(self, source: int, bits: int) -> None:
        if not 1 <= bits <= 32:
            raise ValueError(f"in takes 1 to 32 bits, not {bits}")
        self._put(_IN << 13 | source << 5 | bits & 31)

    def push(self, how: int = 0) -> None:
        self._put(_PUSH << 13 | (0 if how & 1 else 1 << 5))

    def mov(self, target: int, source: int) -> None:
        self._put(_MOV << 13 | target << 5 | source)

    def irq(self, index: int) -> None:
        self._put(_IRQ << 13 | index)

    def set(self, target: int, number: int) -> None:
        self._put(_SET << 13 | target << 5 | number)

    def nop(self) -> None:
        self.mov(_PLACES["y"], _PLACES["y"])

    def assembled(self) -> list[int]:
        """The instructions, jumps still counted from the program's beginning."""
        return [code | (self._labels[label] if label else 0) for code, label in self._code]


def asm_pio(**_settings: object) -> Callable[[Callable[[], None]], list[int]]:
    """`rp2.asm_pio`: the decorated function, called once, writes its program."""

    def assemble(program: Callable[[], None]) -> list[int]:
        assembler = Assembler()
        types.FunctionType(program.__code__, assembler.words())()
        return assembler.assembled()

    return assemble


class Wiring(Protocol):
    """What a machine sees of its board: the time, and the levels of pins."""

    def now_us(self) -> float: ...
    def wait_us(self, us: float) -> None: ...
    def levels(self, first: int, n: int) -> int: ...


@dataclass
class Registers:
    """All that a machine remembers."""

    pc: int = 0
    x: int = 0
    y: int = 0
    isr: int = 0


class StateMachine:
    """`rp2.StateMachine`, run on up to the present whenever something looks at it or its pins change."""

    board: Wiring
    running: list[StateMachine]

    def __init__(self, number: int, program: list[int], freq: int, in_base: Any) -> None:
        if len(program) > MEMORY:
            raise OSError(12, "the program does not fit into the block")
        self.number = number
        self.registers = Registers()
        self.waiting: list[int] = []
        # like the SDK: as high in memory as it fits, jumps moved there
        offset = MEMORY - len(program)
        self._memory = [0] * offset + [c + offset if c >> 13 == _JMP else c for c in program]
        self._first = self.registers.pc = offset
        self._base = in_base.name
        self._cycle_us = 1e6 / freq
        self._active = False
        self._since_us = 0.0
        self._handler: Callable[[StateMachine], None] | None = None
        self.running.append(self)

    def active(self, on: int) -> None:
        self.catch_up()
        self._active = bool(on)
        self._since_us = self.board.now_us()

    def irq(self, handler: Callable[[StateMachine], None], hard: bool = False) -> None:
        assert hard, "a soft interrupt would come late"
        self._handler = handler

    def exec(self, text: str) -> None:
        """One instruction at once."""
        assembler = Assembler()
        exec(text, assembler.words())
        (code,) = assembler.assembled()
        self._execute(code)

    def rx_fifo(self) -> int:
        """How many words wait to be read."""
        self.catch_up()
        return len(self.waiting)

    def get(self, buffer: array[int]) -> array[int]:
        """Fill the buffer with words; wait for those that are not there yet."""
        mask = (1 << 8 * buffer.itemsize) - 1
        for i in range(len(buffer)):
            self.catch_up()
            began_us = self.board.now_us()
            while not self.waiting:
                if not self._active or self.board.now_us() - began_us > LONGEST_WAIT_US:
                    raise TimeoutError("the machine pushes no words: a board would wait for ever")
                self.board.wait_us(self._cycle_us)
                self.catch_up()
            buffer[i] = self.waiting.pop(0) & mask
        return buffer

    def catch_up(self) -> None:
        """Do the cycles up to now, with the pins as they have been since the last time."""
        if not self._active:
            return
        left = int((self.board.now_us() - self._since_us) / self._cycle_us)
        self._since_us += left * self._cycle_us
        seen: dict[tuple[int, ...], int] = {}
        while left > 0:
            r = self.registers
            state = (r.pc, r.x, r.y, r.isr, len(self.waiting))
            if state in seen:  # with still pins it turns in a circle: whole turns change nothing
                left %= seen[state] - left
                seen = {}
                if not left:
                    break
            seen[state] = left
            code = self._memory[r.pc]
            r.pc = self._first if r.pc == MEMORY - 1 else r.pc + 1
            self._execute(code)
            left -= 1

    def _execute(self, code: int) -> None:
        r, kind, middle, low = self.registers, code >> 13, code >> 5 & 7, code & 31
        assert not code >> 8 & 31, "delays and side sets are not emulated"
        if kind == _JMP:
            if self._jumps(middle):
                r.pc = low
        elif kind == _IN:
            bits = low or 32
            r.isr = (r.isr << bits | self._source(middle, bits)) & _WORD
        elif kind == _PUSH and not middle:
            if len(self.waiting) < FIFO:  # else the word is lost, and the machine goes on
                self.waiting.append(r.isr)
            r.isr = 0
        elif kind == _MOV:
            value = self._source(low & 7)
            self._write(middle, ~value & _WORD if low & 8 else value)
        elif kind == _IRQ and low == 16:
            assert self._handler, "nobody listens"
            self._handler(self)
        elif kind == _SET:
            self._write(middle, low)
        else:
            raise NotImplementedError(f"instruction {code:04x}")

    def _jumps(self, condition: int) -> bool:
        r = self.registers
        if condition == 2:
            r.x, before = (r.x - 1) & _WORD, r.x
            return bool(before)
        if condition == 4:
            r.y, before = (r.y - 1) & _WORD, r.y
            return bool(before)
        return {0: True, 1: not r.x, 3: not r.y, 5: r.x != r.y}[condition]

    def _source(self, place: int, bits: int = 32) -> int:
        r = self.registers
        if place == 0:
            return self.board.levels(self._base, bits)
        return {1: r.x, 2: r.y, 3: 0, 6: r.isr}[place] & ((1 << bits) - 1)

    def _write(self, place: int, value: int) -> None:
        setattr(self.registers, {1: "x", 2: "y", 5: "pc", 6: "isr"}[place], value & _WORD)

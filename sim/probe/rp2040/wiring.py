"""The circuit on the pins of an emulated RP2040, as docs/howto/build-the-probe.md has it."""

from __future__ import annotations

from typing import Any

from palpate.sim.probe.circuit import Matrix, Mcp3204
from palpate.sim.probe.hand import TICK_US, Hand

ADDRESS, DIN, A, B, DOUT, SELECT, CLOCK, LED = 2, 10, 11, 12, 16, 17, 18, 25


class ReferenceCircuit:
    """An external device of rp2040py: matrix, multiplexers, converter, encoder and potentiometer.

    Parameters: matrix, and the hand that presses it and turns the wheel. The hand begins when the firmware's
    LED says that a stream has begun.
    """

    def __init__(self, matrix: Matrix, hand: Hand) -> None:
        self.matrix, self.hand = matrix, hand
        self.converter = Mcp3204(matrix)

    def attach(self, rp2040: Any) -> None:
        """Solder it on."""
        self._chip = rp2040
        self._clock = rp2040.clock
        self._pio = rp2040.pio[1]
        self._dout = rp2040.gpio[DOUT]
        self._dout.set_input_value(0)
        self._wheel = rp2040.gpio[A], rp2040.gpio[B]
        self._levels = (-1, -1)
        for n in range(ADDRESS, ADDRESS + 8):
            rp2040.gpio[n].add_listener(self._address)
        rp2040.gpio[SELECT].add_listener(self._select)
        rp2040.gpio[CLOCK].add_listener(self._edge)
        rp2040.gpio[LED].add_listener(self._lamp)
        self._bit = 0
        self._tick = self._clock.create_alarm(self._turn)
        self._turn()

    def _address(self, _now: Any, _before: Any) -> None:
        address = self._pio.pin_values >> ADDRESS
        self.matrix.address(address & 15, address >> 4 & 15, self._clock.micros)

    def _select(self, now: Any, _before: Any) -> None:
        self.converter.select(int(now.value == 1), self._clock.micros)

    def _edge(self, now: Any, _before: Any) -> None:
        if now.value == 1:
            self.converter.rise(self._pio.pin_values >> DIN & 1, self._clock.micros)
            return
        bit = self.converter.fall(self._clock.micros)
        if bit is not None and bit != self._bit:
            self._bit = bit
            self._dout.set_input_value(bit)

    def _lamp(self, now: Any, _before: Any) -> None:
        if now.value == 1:
            self.hand.begin(self._clock.micros)
        else:
            self.hand.end()

    def _turn(self) -> None:
        levels = self.hand.tick(self._clock.micros)
        if levels != self._levels:
            for pin, level, before in zip(self._wheel, levels, self._levels, strict=True):
                if level != before:
                    pin.set_input_value(level)
            self._levels = levels
        self._tick.schedule(TICK_US * 1000)

"""The reference probe's circuit: matrix, multiplexers, amplifiers and the MCP3204, pin by pin. Times in us.

What the parts do, and how long they take, is from their data sheets. It knows nothing of who moves the pins:
`palpate.sim.probe.rp2040` puts it on an emulated RP2040, and a test on wires of its own.
"""

import math

import numpy as np

from firmware_py import geometry

MCP3204_MAX_HZ = 1_200_000  # at 3.3 V, between 1 MHz at 2.7 V and 2 MHz at 5 V
SELECT_HIGH_US = 0.5  # the MCP3204 wants to be let go so long between two conversions
CHANNEL_A, CHANNEL_B, DISPLACEMENT = 0, 1, 2
COLUMNS_ON_A = 16
COLUMNS, FULL = geometry.COLUMNS, geometry.FULL_COUNT


class CircuitError(Exception):
    """The firmware treats a part as its data sheet forbids."""


class Matrix:
    """Cells, row and column multiplexers, and the two amplifiers behind them.

    Parameters
    settling_us: time constant of the amplifiers

    Attributes: cells (counts that the sensors would give, settled, in their order), displacement_counts.
    """

    def __init__(self, settling_us: float = 1.0) -> None:
        self.cells = np.zeros(geometry.CELLS, int)
        self.displacement_counts = 0.0
        self.settling_us = settling_us
        self._levels = [0.0, 0.0]
        self._targets = [0.0, 0.0]
        self._changed_us = -1e9

    def address(self, row: int, column: int, now_us: float) -> None:
        """The multiplexers' pins have changed: the amplifiers start towards another cell."""
        self._levels = [self.level(CHANNEL_A, now_us), self.level(CHANNEL_B, now_us)]
        self._changed_us = now_us
        first = row * COLUMNS
        on_b = COLUMNS_ON_A + column
        self._targets = [
            float(self.cells[first + column]),
            float(self.cells[first + on_b]) if on_b < COLUMNS else 0.0,
        ]

    def level(self, channel: int, now_us: float) -> float:
        """What the converter sees on one of its channels, in counts."""
        if channel == DISPLACEMENT:
            return self.displacement_counts
        if channel > DISPLACEMENT:
            return 0.0
        target = self._targets[channel]
        if not self.settling_us:
            return target
        left = math.exp(-(now_us - self._changed_us) / self.settling_us)
        return target + (self._levels[channel] - target) * left


class Mcp3204:
    """The converter, clock by clock (data sheet DS21298E, figure 5-1)."""

    def __init__(self, matrix: Matrix) -> None:
        self._matrix = matrix
        self._selected = False
        self._let_go_us = self._risen_us = -1e9
        self._clocks = -1  # since the start bit; -1: it has not come
        self._channel = 0
        self._bits = 0
        self.conversions = 0

    def select(self, level: int, now_us: float) -> None:
        """The chip select's pin: 0 begins a conversion, 1 ends it."""
        if level:
            self._selected = False
            self._let_go_us = now_us
            return
        if now_us - self._let_go_us < SELECT_HIGH_US:
            raise CircuitError(f"selected again after {now_us - self._let_go_us:.2f} us")
        self._selected, self._clocks, self._channel = True, -1, 0

    def rise(self, din: int, now_us: float) -> None:
        """The clock rises: the chip takes a bit."""
        if not self._selected:
            return
        if now_us - self._risen_us < 1e6 / MCP3204_MAX_HZ:
            raise CircuitError(f"a clock of {now_us - self._risen_us:.2f} us is too short")
        self._risen_us = now_us
        if self._clocks >= 0 or din:
            self._clocks += 1
        if self._clocks == 1 and not din:
            raise CircuitError("a differential conversion: nothing here is wired for it")
        if self._clocks in (3, 4):
            self._channel = self._channel << 1 | din

    def fall(self, now_us: float) -> int | None:
        """The clock falls: what DOUT shows from here on, or None if it stays as it is."""
        if not self._selected:
            return None
        if self._clocks == 5:
            counts = round(self._matrix.level(self._channel, now_us))
            self._bits = min(max(counts, 0), FULL)
            self.conversions += 1
            return 0
        if 6 <= self._clocks <= 17:
            return self._bits >> 17 - self._clocks & 1
        return None

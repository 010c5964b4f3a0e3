"""The 16 x 26 sensor matrix: a multiplexer drives one row, two choose the column for each of two ADC
channels.

Columns are walked in Gray order, so that one address pin changes from one cell to the next and no third
channel is touched on the way. Allocates nothing.
"""

from array import array
from time import sleep_us

from machine import Pin

from firmware_py.boards import mcp3202

ROWS = 16
COLUMNS = 26
_FIRST = 16  # columns on multiplexer A, ADC channel 0; the other ten are on B, channel 1


def _gray_steps() -> tuple[bytes, bytes]:
    """Which address pin changes at each of 16 steps (cyclically), and the address reached."""
    pins = bytearray(16)
    addresses = bytearray(16)
    before = 8  # the Gray code of 15: the last step of the row before
    for k in range(16):
        code = k ^ k >> 1
        changed = code ^ before
        pin = 0
        while changed >> pin != 1:
            pin += 1
        pins[k] = pin
        addresses[k] = code
        before = code
    return bytes(pins), bytes(addresses)


class Matrix:
    """Scans the matrix.

    Parameters
    adc: the converter behind both column multiplexers
    row_pins, column_pins: four address pins each, least significant first
    settle_us: what the amplifiers need after a row was changed (a column change settles during the select)
    """

    def __init__(
        self,
        adc: mcp3202.MCP3202,
        row_pins: "tuple[Pin, ...]",
        column_pins: "tuple[Pin, ...]",
        settle_us: int = 20,
    ) -> None:
        self._adc = adc
        self._row_pins = row_pins
        self._column_pins = column_pins
        self._settle_us = settle_us
        self._pins, self._addresses = _gray_steps()
        self._line = array("H", bytes(2 * COLUMNS))
        for bit in range(4):
            row_pins[bit].value(0)
            column_pins[bit].value(8 >> bit & 1)  # where the Gray walk begins
        self._levels = bytearray(4)
        self._levels[3] = 1

    def scan(self, counts: "memoryview | bytearray") -> None:
        """Measure all cells into 624 bytes.

        Rows along the stroke one after the other, two cells in three bytes.
        """
        at = 0
        line = self._line
        for row in range(ROWS):
            for bit in range(4):
                self._row_pins[bit].value(row >> bit & 1)
            sleep_us(self._settle_us)
            self._scan_row(line)
            for column in range(0, COLUMNS, 2):
                v = line[column]
                w = line[column + 1]
                counts[at] = v & 255
                counts[at + 1] = v >> 8 | (w & 15) << 4
                counts[at + 2] = w >> 4
                at += 3

    def _scan_row(self, line: "array[int]") -> None:
        levels = self._levels
        read = self._adc.read
        for step in range(16):
            pin = self._pins[step]
            level = 1 - levels[pin]
            levels[pin] = level
            self._column_pins[pin].value(level)
            address = self._addresses[step]
            line[address] = read(0)
            if address < COLUMNS - _FIRST:
                line[_FIRST + address] = read(1)

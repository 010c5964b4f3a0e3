"""The matrix into a frame, and a frame's rows summed, as machine code (viper): the same numbers."""

# ruff: noqa: F821 - ptr8 and ptr16 are viper's own
import micropython

from firmware_py import geometry, stroke_state
from firmware_py.boards import scan_order

_CELLS = geometry.CELLS
_ROWS = geometry.ROWS
_COLUMNS = geometry.COLUMNS


@micropython.viper
def pack(raw: ptr16, places: ptr16, counts: ptr8):  # type: ignore[name-defined]
    """See scan_order.pack."""
    at = 0
    i = 0
    n = int(_CELLS)
    while i < n:
        v = raw[places[i]]
        w = raw[places[i + 1]]
        counts[at] = v & 255
        counts[at + 1] = v >> 8 | (w & 15) << 4
        counts[at + 2] = w >> 4
        at += 3
        i += 2


@micropython.viper
def row_sums(packed: ptr8, sums: ptr32):  # type: ignore[name-defined]
    """See stroke_state.row_sums."""
    at = 0
    row = 0
    while row < int(_ROWS):
        line = 0
        end = at + (int(_COLUMNS) >> 1) * 3
        while at < end:
            b = packed[at + 1]
            line += (packed[at] | (b & 15) << 8) + (b >> 4 | packed[at + 2] << 4)
            at += 3
        sums[row] = line
        row += 1


def install():
    """Put the machine code in the place of the plain loops."""
    scan_order.pack = pack
    stroke_state.row_sums = row_sums

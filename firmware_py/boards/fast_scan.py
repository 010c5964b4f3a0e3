"""scan_order.pack as machine code (viper): the same bytes."""

# ruff: noqa: F821 - ptr8 and ptr16 are viper's own
import micropython

from firmware_py import geometry
from firmware_py.boards import scan_order

_CELLS = geometry.CELLS


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


def install():
    """Put the machine code in the place of the plain loop."""
    scan_order.pack = pack

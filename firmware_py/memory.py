"""The one big block of memory, taken before anything else is imported.

A board with little memory reserves the cells' block as its first deed (boards/rp2_reference.py): once modules
are loaded, no hole is large enough for it.
"""

from array import array

from firmware_py import geometry

BINS = 64

_reserved = []  # type: list[array[int]]


def reserve():
    """Take the block for `BINS` bins of cells now; `cells` will hand it out."""
    _reserved.append(_block(geometry.CELLS * BINS))


def cells(n):
    """An array of n numbers of 16 bits; what is in it is written over before it is read."""
    if _reserved and len(_reserved[0]) == n:
        return _reserved.pop()
    return _block(n)


def _block(n):
    # from a range, the array is the only thing allocated
    return array("H", range(n)) if n < 65536 else array("H", bytes(2 * n))

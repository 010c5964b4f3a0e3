"""A small board's memory: the one big block, taken first, and modules that are needed seldom, given back.

A board with little memory reserves the cells' block as its first deed (boards/rp2_reference.py): once modules
are loaded, no hole is large enough for it.
"""

import gc
import sys
from array import array

from firmware_py import geometry

BINS = 55  # 82.5 mm of travel: with many more, 40 kB would not stay free beside a model of two stages
SIGNATURE = ("signature", "slh_dsa", "sha_thumb")
# what checks and loads a model
FLASHING = SIGNATURE + ("model_image", "model_check", "unpack", "stage_image")
CALIBRATING = ("calibrate", "reference")

_reserved = []  # type: list[array[int]]
_small = []  # type: list[bool]


def loaded():
    """Called when no more modules are to be imported for a while: main.py puts its own in this place."""


def reserve():
    """On a small board: take the block for `BINS` bins of cells now; `cells` will hand it out."""
    _small.append(True)
    _reserved.append(_block(geometry.CELLS * BINS))


def cells(n):
    """An array of n numbers of 16 bits; what is in it is written over before it is read."""
    if _reserved and len(_reserved[0]) == n:
        return _reserved.pop()
    return _block(n)


def forget(names):
    """On a small board: give back the code of these modules; importing one loads it again."""
    if _small:
        loaded()
        give_back(names)


def give_back(names):
    """The same where more modules are about to be imported."""
    if not _small:
        return
    for name in names:
        if sys.modules.pop("firmware_py." + name, None):
            delattr(sys.modules["firmware_py"], name)
    gc.collect()


def tidy():
    """On a small board, before something that stays is made: what was needed for a moment leaves its place.

    Otherwise what stays would lie behind it, and what is free in the end in a hundred pieces.
    """
    if _small:
        gc.collect()


def _block(n):
    """n numbers; the array grows where it lies, by doubling, and nothing else is allocated on the way."""
    first = n
    while first > 64 and not first & 1:
        first >>= 1
    block = array("H", bytes(2 * first))
    while len(block) < n:
        block.extend(block)
    return block

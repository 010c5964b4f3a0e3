"""Runs a script beside `firmware_py` in MicroPython and returns its output: for vectors and proofs."""

import json
import os
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

import firmware_py
from firmware_py import sensor_array
from palpate.errors import PalpateError
from palpate.sim.probe import node

FIRMWARE = Path(firmware_py.__file__).parent


class ScriptFailed(PalpateError):
    """The script ended with an error; the message is what it said."""


def run_micropython(
    script: str,
    files: Mapping[str, bytes] | None = None,
    heap: int = 1 << 20,
    timeout_s: float = 900,
    turns: int = 0,
) -> str:
    """Run a script in real MicroPython (WASM under Node).

    Parameters
    script: its text; `firmware_py` can be imported, the working directory holds `files`
    files: name -> contents
    heap: of MicroPython, in bytes (it grows: it proves nothing about memory)
    timeout_s: give up after so many seconds
    turns: how often the script's function `turn` is called after it, the heap cleared before each time, as it
        never is while a script runs

    Returns what it printed. Raises ScriptFailed, node.RuntimeMissing, subprocess.TimeoutExpired.
    """
    node.check_wasm()
    with tempfile.TemporaryDirectory(prefix="palpate-script-") as scratch:
        folder = Path(scratch)
        (folder / "script.py").write_text(script)
        names = {}
        for i, (name, contents) in enumerate((files or {}).items()):
            (folder / f"file-{i}").write_bytes(contents)
            names[name] = str(folder / f"file-{i}")
        config = {
            "firmware": str(FIRMWARE),
            "array": str(sensor_array.__file__),
            "files": names,
            "script": str(folder / "script.py"),
            "heap": heap,
            "turns": turns,
        }
        (folder / "config.json").write_text(json.dumps(config))
        done = subprocess.run(
            [node.node(), str(Path(__file__).with_suffix(".mjs")), str(folder / "config.json")],
            cwd=folder, capture_output=True, text=True, timeout=timeout_s,
            env={**os.environ, "PYTHONPATH": str(FIRMWARE.parent)},
        )  # fmt: skip
    if done.returncode:
        raise ScriptFailed((done.stderr or done.stdout).strip()[-4000:])
    return done.stdout

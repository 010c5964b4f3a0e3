"""What Windows lacks is not needed: the chain from tissue to page where POSIX's modules cannot be imported.

It runs on Linux, so it shows that much and no more: the emulator also hands pipes to a process.
"""

import contextlib
import json
import os
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

BLOCKED = """
import builtins, sys

found = builtins.__import__
POSIX = {"fcntl", "termios", "pty", "tty", "grp", "pwd", "resource"}


def without(name, globals=None, *more, **named):
    ours = (globals or {}).get("__name__", "").partition(".")[0] in ("palpate", "firmware_py", "__main__")
    if ours and name in POSIX:
        raise ImportError(f"no module named {name!r} here")
    return found(name, globals, *more, **named)


builtins.__import__ = without
"""
STROKES = Path(__file__).parent / "host" / "report" / "data"


@pytest.fixture
def environment(tmp_path):
    """Every Python that starts with it lacks these modules, wherever our own code asks for them."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "sitecustomize.py").write_text(BLOCKED)
    return os.environ | {"PYTHONPATH": str(tmp_path / "site"), "XDG_RUNTIME_DIR": str(tmp_path)}


@pytest.fixture
def palpate(environment, tmp_path):
    def run(*words: object) -> str:
        command = [sys.executable, "-m", "palpate.cli", *map(str, words)]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


@contextlib.contextmanager
def running(environment, place, *words):
    """A command that goes on until the block ends; its first line."""
    command = [sys.executable, "-m", "palpate.cli", *map(str, words)]
    process = subprocess.Popen(command, cwd=place, env=environment, stdout=subprocess.PIPE, text=True)
    try:
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        process.communicate(timeout=60)


@pytest.mark.long
def test_the_chain_needs_no_module_of_posix(palpate, environment, tmp_path):
    blocked = "from palpate.sim.probe.endpoints import endpoint; endpoint('pty')"
    refused = subprocess.run([sys.executable, "-c", blocked], env=environment, capture_output=True, text=True)
    assert "no pseudo-terminals; emulate with --listen tcp" in refused.stderr, "these are really blocked"
    palpate("simulate", "d12h07e20f06")
    palpate("fit", STROKES, "--out", "model.json")
    palpate("keygen", "key")
    palpate("export", "model.json", "--key", "key", "--out", "model.palp")
    emulator = ("emulate", "d12h07e20f06", "--listen", "tcp:127.0.0.1:0")
    with running(environment, tmp_path, *emulator, "--runtime", "cpython") as port:
        assert port.startswith("socket://")
        told = json.loads(palpate("stream", "--port", port, "--strokes", 1, "--record", "v.mcap", "--json"))
        assert told["strokes"][0]["lump"]
        palpate("replay", "v.mcap")
        with running(environment, tmp_path, "view", "--port", port, "--no-browser", "--http-port", 0) as said:
            url = next(word for word in said.split() if word.startswith("http"))
            (token,) = tmp_path.rglob("viewer-token")
            page = urllib.request.urlopen(f"{url}?token={token.read_text()}", timeout=60)
            assert b"Palpate" in page.read()

"""`mpremote mip install`, the real one, onto real MicroPython behind a pseudo-terminal, as onto a board."""

import json
import os
import pty
import shlex
import shutil
import subprocess
import sys
import tty
from pathlib import Path

import pytest

from palpate.cli import main
from palpate.sim.probe import node
from tests.docs.blocks import DOCS, blocks_of
from tests.firmware_py import install_files

FEW = ("__init__.py", "cobs.py", "crc.py")


@pytest.fixture
def board(tmp_path):
    """A prompt's port, and the directory that holds the board's files once it is switched off."""
    node.check_wasm()
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    kept = tmp_path / "flash"
    prompt = Path(__file__).with_name("prompt.mjs")
    process = subprocess.Popen([node.node(), prompt, kept], stdin=ours, stdout=ours)
    os.close(ours)

    def switch_off():
        nonlocal theirs
        if theirs is not None:
            os.close(theirs)
            theirs = None
        process.wait(120)
        return kept

    yield os.ttyname(theirs), switch_off
    switch_off()


def mpremote(port, *words):
    command = [sys.executable, "-m", "mpremote", "connect", port, "resume", *words]
    done = subprocess.run(
        command, cwd=install_files.FIRMWARE.parent, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:] + done.stdout[-2000:]
    return done.stdout


@pytest.mark.long
def test_the_boards_files_are_copied_by_the_lines_of_the_page(board, tmp_path):
    """What `palpate board` makes, by the lines that docs/firmware.md gives. A minute: 256 bytes at a time.

    This interpreter has another processor; that the files run is tests/sim/probe/test_rp2040.py's to show.
    """
    port, switch_off = board
    key = tmp_path / "key"
    key.mkdir()
    (key / "public.key").write_bytes(bytes(range(56)))
    (block,) = [b for b in blocks_of(DOCS / "firmware.md") if "palpate board" in b.text]
    (again,) = [b for b in blocks_of(DOCS / "tutorial" / "board.md") if "palpate board" in b.text]
    assert again.text == block.text.replace("KEYDIR", "out/key")
    made = tmp_path / "board"
    for line in block.text.replace("KEYDIR", str(key)).replace("out/board", str(made)).splitlines():
        tool, *words = shlex.split(line)
        if tool == "palpate":
            assert main(words) == 0
        elif words != ["reset"]:  # this port of MicroPython has none: the prompt's end switches it off
            mpremote(port, *words)
    kept = switch_off()
    files = [path for path in made.rglob("*") if path.is_file()]
    assert len(files) == 3
    for path in files:
        assert (kept / path.relative_to(made)).read_bytes() == path.read_bytes()


def test_three_modules_install_and_run(board, tmp_path):
    """The same by a shorter list, in `make test`."""
    port, switch_off = board
    rows = [row for row in json.loads(install_files.PACKAGE.read_text())["urls"] if row[1] in FEW]
    assert len(rows) == len(FEW)
    for _, name in rows:
        shutil.copy(install_files.FIRMWARE / name, tmp_path)
    (tmp_path / "package.json").write_text(json.dumps({"urls": rows, "version": "1"}))
    assert "Done" in mpremote(port, "mip", "install", str(tmp_path / "package.json"))
    used = mpremote(port, "exec", "from firmware_py import cobs, crc; print(crc.SIZE, cobs.worst_case(10))")
    from firmware_py import cobs, crc

    assert used.split() == [str(crc.SIZE), str(cobs.worst_case(10))]
    installed = switch_off() / "lib" / "firmware_py"
    assert sorted(p.name for p in installed.iterdir()) == sorted(FEW)

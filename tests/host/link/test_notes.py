"""Notes of emulated probes: nobody else's are believed, and none can write on the terminal."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from contextlib import closing

import pytest

from palpate.errors import CommandTimeout, PalpateError, PortMissing
from palpate.link import emulated
from palpate.link.devices import Place
from palpate.link.line import Line
from palpate.link.transport import open_transport

NOTE = {"port": "socket://127.0.0.1:9", "pid": os.getpid(), "code": "d10h08e10f10", "runtime": "cpython"}


@pytest.fixture
def fallback(tmp_path, monkeypatch):
    """The directory that is used without XDG_RUNTIME_DIR, in a shared temporary one."""
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr(emulated.tempfile, "gettempdir", lambda: str(tmp_path))
    return emulated.directory()


def plant(folder, **words):
    folder.mkdir(mode=0o700, exist_ok=True)
    (folder / "1.json").write_text(json.dumps(NOTE | words))


def test_ours_is_read(fallback):
    plant(fallback)
    assert [note.port for note in emulated.running()] == [NOTE["port"]]


def test_a_probe_that_was_started_again_at_its_address_is_found(fallback):
    """A stream waited for ever: it looked for the process that had ended."""
    plant(fallback)
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    assert Place(NOTE["port"], pid=ended.pid).port_now() == NOTE["port"]
    with pytest.raises(PortMissing, match="start it again"):
        Place("socket://127.0.0.1:8", pid=ended.pid).port_now()


def test_a_directory_that_somebody_else_made_is_neither_read_nor_written(fallback, monkeypatch):
    """A note planted there made `palpate devices` connect to a foreign port."""
    plant(fallback)
    monkeypatch.setattr(os, "getuid", lambda: fallback.stat().st_uid + 1)
    monkeypatch.setattr(emulated, "directory", lambda: fallback)
    assert emulated.running() == []
    with pytest.raises(PalpateError, match="belongs to another user"):
        emulated.leave(emulated.Note(**NOTE))


@pytest.mark.skipif(os.name == "nt", reason="POSIX permissions")
def test_nor_is_one_that_others_can_write_or_a_link(fallback, tmp_path):
    plant(fallback)
    fallback.chmod(0o777)
    assert emulated.running() == []
    fallback.chmod(0o700)
    fallback.rename(tmp_path / "elsewhere")
    fallback.symlink_to(tmp_path / "elsewhere")
    assert emulated.running() == []


@pytest.mark.parametrize(
    "words",
    [{"code": "\x1b[2J\x1b]0;owned\x07"}, {"runtime": "a\nb"},
     {"port": "\x9b31m"}, {"pid": "1"}, {"pid": True},
     {"port": None}, {"code": ["x"]}, {"times_slower": "9"}, {"times_slower": 0}, {"times_slower": 1e9}],
)  # fmt: skip
def test_no_note_prints_escape_codes_or_makes_a_host_wait_for_ever(fallback, words):
    plant(fallback, **words)
    assert emulated.running() == []


def test_a_probe_that_is_many_times_slower_is_waited_for_so_much_longer(fallback):
    """Nobody got a word out of an emulated board: each command gave it up after six seconds, a third of one
    of its own."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = f"socket://127.0.0.1:{silent.getsockname()[1]}"
        for slower, waited in ((1, "0.02 s"), (25, "0.5 s")):
            plant(fallback, port=port, times_slower=slower)
            with closing(Line(open_transport(port))) as line, pytest.raises(CommandTimeout, match=waited):
                line.ask("statistics", timeout_s=0.02)


def test_notes_that_are_no_notes_are_passed_over(fallback):
    plant(fallback)
    for k, text in enumerate(("[" * 100000, "{}", "\xff", "[1]", '{"port": 1e999}')):
        (fallback / f"bad-{k}.json").write_bytes(text.encode("latin-1"))
    assert len(emulated.running()) == 1

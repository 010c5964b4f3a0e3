"""`palpate view` as a user types it."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import urllib.request

import pytest
from websockets.sync.client import connect

from palpate.link import emulated as notes
from tests.host.processes import start_palpate
from tests.host.view.asking import by_number
from tests.host.view.waiting import PATIENCE_S


def test_help_shows_examples_that_name_both_uses(palpate):
    status, out, _ = palpate("view", "--help")
    assert status == 0
    assert "palpate view --port auto" in out and "palpate view monday.mcap" in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("a.mcap", "--port", "auto"), "either --port PORT for a probe or the FILE.mcap"),
        (("nowhere.mcap",), "there is no recording nowhere.mcap"),
        (("notes.txt",), "should end in .mcap"),
        (("--port", "auto", "--http-port", "99999"), "99999"),
    ],
)
def test_invalid_arguments_are_one_sentence_and_status_2(palpate, words, said):
    status, out, err = palpate("view", "--no-browser", *words)
    assert status == 2 and out == ""
    assert said in err and err.count("\n") == 1 and "Traceback" not in err


def test_a_file_that_is_no_recording_is_refused(palpate, tmp_path):
    (tmp_path / "x.mcap").write_bytes(b"hello")
    status, _, err = palpate("view", "--no-browser", tmp_path / "x.mcap")
    assert status == 2 and "is not a recording" in err


def _link(message):
    """What a message to the page says of the link, if it does."""
    told = json.loads(message) if isinstance(message, str) else {}
    return told.get("link", {"state": "", "text": ""})


def test_a_port_in_use_is_said_with_what_to_do(palpate):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        status, _, err = palpate(
            "view", "--no-browser", "--port", "socket://127.0.0.1:9", "--http-port", port
        )
    assert status == 1 and "in use" in err and "--http-port" in err


@pytest.mark.parametrize("plugged", [True, False])
def test_a_bare_view_takes_the_probe_that_is_there_or_waits_for_one(emulated, tmp_path, plugged):
    """It was refused, while the other commands looked for a probe by themselves."""
    if plugged:
        notes.leave(notes.Note(emulated().port, os.getpid(), "d10h08e10f10", "cpython"))
    with start_palpate("view", "--no-browser", "--http-port", 0, "--recordings", tmp_path) as process:
        url, token = re.search(r"Palpate is at (\S+/)\?token=(\S+) ", process.stdout.readline()).groups()
        address = by_number(url).replace("http:", "ws:") + "ws"
        with connect(address, additional_headers={"Authorization": f"Bearer {token}"}, max_size=None) as page:
            links = (_link(page.recv(PATIENCE_S)) for _ in range(1000))
            link = next(one for one in links if one["state"] == "connected" or "again" in one["text"])
        assert (link["state"] == "connected") is plugged, link
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE_S)
    waits = "no probe found; plug one in" in err and "the page waits for it" in err
    assert waits is not plugged and "Traceback" not in err, err


@pytest.mark.parametrize("beyond_localhost", [(), ("--host", "0.0.0.0")])
def test_it_serves_who_has_the_printed_link_until_interrupted_and_ends_cleanly(tmp_path, beyond_localhost):
    process = start_palpate(
        "view", "--port", "socket://127.0.0.1:9", "--no-browser", "--http-port", 0, "--recordings", tmp_path,
        *beyond_localhost,
    )  # fmt: skip
    try:
        line = process.stdout.readline()
        port, token = re.search(r"http://\S+:(\d+)/\?token=([\w-]{20,})", line).groups()
        url = f"http://127.0.0.1:{port}/"
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(url, timeout=PATIENCE_S)
        assert refused.value.code == 401
        request = urllib.request.Request(url, headers={"Authorization": f"Bearer {token}"})
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            assert b"<title>Palpate</title>" in answer.read()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    assert process.returncode in (0, 130) and "Traceback" not in err

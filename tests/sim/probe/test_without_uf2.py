"""Where MicroPython for the Pico is not to be had: what is not tried is counted, and each way to it named."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from palpate.sim.probe.rp2040 import interpreter
from tests.host.cli.sentences import one_sentence

ROOT = Path(__file__).parents[3]


def test_the_last_lines_of_the_tests_say_how_many_promises_were_not_tried_and_how_to_try_them():
    environment = {**os.environ, interpreter.VARIABLE: "/nowhere/RPI_PICO.uf2", "PYTEST_ADDOPTS": ""}
    words = "-m pytest -n 1 -m board tests/sim/probe/test_rp2040_start.py"
    command = [sys.executable, *words.split()]
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    *_, title, said, summary = done.stdout.strip().splitlines()
    assert "not tried" in title
    (skipped,) = re.findall(r"(\d+) skipped", summary)
    assert int(skipped) > 1
    assert said.startswith(f"{skipped} promises of the reference board were not tried")
    assert "micropython.org" in said and f"{interpreter.VARIABLE}=/path/to/it make test" in said


@pytest.mark.parametrize(
    ("named", "status", "why"),
    [("/nowhere/RPI_PICO.uf2", 2, "which is no file"), ("", 1, "could not be fetched")],
)
def test_the_board_is_not_emulated_without_it_and_one_sentence_says_why(
    palpate, monkeypatch, named, status, why
):
    firmware_retrieve = pytest.importorskip("rp2040py.utils.firmware_retrieve")
    monkeypatch.setattr(firmware_retrieve, "retrieve", lambda *_: None)
    monkeypatch.setenv(interpreter.VARIABLE, named)
    code, said, wrong = palpate("emulate", "d12h07e20f09", "--board", "rp2040")
    assert code == status and said == ""
    assert one_sentence(wrong) and why in wrong and interpreter.VARIABLE in wrong


def test_a_missing_extra_is_said_before_a_port_is(monkeypatch, palpate):
    """`emulate --board` printed a port, and died of "No module named 'littlefs'" minutes later."""
    there = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "littlefs" else there(name))
    status, out, err = palpate("emulate", "d12h07e20f09", "--board", "rp2040")
    assert (
        status == 1 and out == "" and "needs littlefs; install it with: pip install 'palpate[board]'" in err
    )

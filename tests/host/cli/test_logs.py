"""`-v` and `--log-file`: what happened, by Python's own logging; silent unless asked for."""

import json
import logging
import subprocess
import sys

from palpate.link.probe import Probe


def test_a_session_is_logged_into_a_file_behind_what_is_there(palpate, emulated, tmp_path):
    log, visit, device = tmp_path / "log.txt", tmp_path / "visit.mcap", emulated("cpython")
    log.write_text("yesterday\n")
    words = ("--log-file", log, "stream", "--port", device.port, "--strokes", 1, "--record", visit)
    code, _, err = palpate(*words)
    text = log.read_text()
    assert code == 0 and "palpate.link" not in err
    assert text.startswith("yesterday\n") and f"palpate.recording.writer: recording into {visit}" in text
    assert f"palpate.link.probe: {device.port}" in text and "exit status 0" in text


def test_the_options_may_stand_behind_the_command_too(palpate, tmp_path):
    log = tmp_path / "log.txt"
    code, _, err = palpate("simulate", "d12h07", "-v", "--log-file", log)
    assert code == 2 and "INFO" in err and "Traceback" not in err
    assert "Traceback" in log.read_text() and "CaseError" in log.read_text()
    assert not logging.getLogger("palpate").handlers[1:], "closed with the command"


def test_a_log_that_cannot_be_written_is_a_sentence(palpate, tmp_path):
    code, _, err = palpate("doctor", "--log-file", tmp_path / "no" / "log.txt")
    assert code == 2 and "cannot log into" in err


def test_a_log_on_a_full_disk_is_a_sentence_and_the_command_goes_on(palpate):
    """Each record left a traceback, and the last one made a failure of what had succeeded."""
    code, out, err = palpate("devices", "--log-file", "/dev/full", "--json")
    assert code == 0 and json.loads(out)
    assert err.count("\n") == 1 and "no more is logged: the disk is full" in err


def test_a_program_hears_the_probe_by_its_name(emulated, caplog):
    device = emulated("cpython")
    with caplog.at_level(logging.INFO, "palpate"), Probe.open(device.port):
        pass
    assert [r.name for r in caplog.records] == ["palpate.link.probe"]


def test_who_does_not_ask_hears_nothing():
    code = "import logging, palpate; logging.getLogger('palpate.link.line').warning('gone')"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout == said.stderr == ""

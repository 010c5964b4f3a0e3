"""The command line as a user or a script meets it: exit statuses, sentences, JSON, help."""

import json
import os
import subprocess
import sys

import pytest

from palpate.cli.runner import CHAPTERS
from tests.host.cli.sentences import one_sentence
from tests.host.probes import LUMP
from tests.host.processes import start_palpate
from tests.waiting import PATIENCE_S

COMMANDS = [name for chapter in CHAPTERS.values() for name, _, _ in chapter]


@pytest.mark.parametrize(
    ("words", "status", "says"),
    [
        (("simulate", "d10h08"), 2, "not a case code; write one like d10h08e10f10"),
        (("simulate", LUMP, "--hx", "fine"), 2, "not a valid float"),
        (("simulate", LUMP, "--hx", "99"), 2, "hx_mm must lie between"),
        (("simulate", LUMP, "--out", "stroke.doc"), 2, r"use .json, .csv, .png, .svg"),
        (("simulate",), 2, "Missing argument 'CODE'"),
        (("simulat", LUMP), 2, "did you mean 'simulate'?"),
        (("zzz",), 2, "lists the commands"),
        (("sweep", "--design", "thesis", "--out", "x", "--workers", 2, "--scheduler", "tcp://h"), 2, "one"),
        (("emulate", LUMP, "--listen", "udp:9"), 2, "pty or tcp:HOST:PORT"),
        (("sweep", "--design", "sobol:many", "--out", "{tmp}/s"), 2, "sobol"),
        (("stream", "--port", "/dev/ttyNOTHERE"), 1, "plug the probe in"),
        (("stream", "--port", "socket://127.0.0.1:1"), 1, "nothing listens"),
        (("stream", "--port", "socket://nowhere"), 2, "socket://HOST:PORT"),
        (("stream", "--port", "NOT-A-SERIAL"), 1, "palpate devices"),
        (("stream",), 1, "no probe found"),
        (("stream", "--strokes", "-1"), 2, "strokes"),
        (("flash", "{tmp}/none.palp"), 2, "there is no model image"),
        (("flash", "{text}"), 2, "not a model image"),
        (("replay", "{tmp}/none.mcap"), 2, "there is no recording"),
        (("replay", "{text}"), 2, "not a recording"),
        (("convert", "{text}", "{tmp}/out.xlsx"), 2, ".parquet"),
        (("emulate", LUMP, "--runtime", "arduino"), 2, "there is no runtime"),
        (("emulate", LUMP, "--noise", "loud"), 2, "none, good, typical, poor"),
        (("emulate", LUMP, "--key", "{tmp}/nokey"), 2, "palpate keygen"),
        (("export", "{text}", "--key", "k", "--out", "o.palp"), 2, "not a readable model.json"),
        (("fit", "{tmp}", "--out", "m.json"), 2, "no finished sweep"),
        (("completion", "tcsh"), 2, "bash"),
        (("calibrate", "gain"), 2, "--pressure"),
        (("settings", "colour"), 2, "frame_rate"),
        (("emulate", LUMP, "--seed", "-1"), 2, "-1 is not in the range"),
        (("calibrate", "gain", "--pressure", "nan"), 2, "is not a finite number"),
        (("calibrate", "gain", "--pressure", "inf"), 2, "is not in the range"),
        (("calibrate", "gain", "--pressure", "1e308"), 2, "is not in the range"),
        (("stream", "--fat", "nan"), 2, "is not a finite number"),
        (("stream", "--timeout", "nan"), 2, "is not a finite number"),
        (("simulate", LUMP, "--start", "nan"), 2, "is not a finite number"),
        (("demo", "--runtime", "nosuch"), 2, "'nosuch' is not one of"),
        (("emulate", LUMP, "--key", "{text}"), 2, "is no public key"),
        (("flash", "/dev/zero"), 2, "too large to be"),
        (("export", "/dev/zero", "--key", "k", "--out", "o.palp"), 2, "too large to be"),
        (("export", "field", "--key", "k", "--out", "o.palp", "--counter", "7"), 2, "are for --rollback"),
        (("emulate", LUMP, "--still", "--reference"), 2, "needs a hand that presses"),
        (("emulate", LUMP, "--as", "reskin", "--press", "0", "--cuff", "3"), 2, "exclude each other"),
        (("emulate", LUMP, "--as", "reskin", "--no-model"), 2, "--no-model is of a probe"),
        (("fit", "{tmp}", "--tissue", "thesis", "--out", "m.json"), 2, "--tissue goes with --kind field"),
        (("fit", "{tmp}", "--lumps", "90", "--out", "m.json"), 2, "go with --kind field"),
        (("view", "--model", "field"), 2, "--model goes with --data"),
        (("simulate", LUMP, "--out", "a.png", "--fields", "a.png"), 2, "both name a.png"),
        (("stream", "--record", "visit.txt"), 2, "a recording's name ends in .mcap"),
    ],
)  # fmt: skip
def test_invalid_arguments_and_missing_things_get_one_sentence(
    palpate, tmp_path, monkeypatch, words, status, says
):
    """On a new machine, too: `fit` announced that it would compile before it looked for the sweep."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "new"))
    text = tmp_path / "text"
    text.write_text("hello, I am text, and long enough to hold any header that one might look for in a file")
    words = [str(word).format(tmp=tmp_path, text=text) for word in words]
    got, out, err = palpate(*words)
    assert says in err
    assert got == status
    assert one_sentence(err) and out == ""


def test_files_of_the_wrong_kind_get_one_sentence(palpate, tmp_path, images):
    pipe, noise, table, cut = (tmp_path / name for name in ("pipe.json", "noise", "table.csv", "cut.palp"))
    os.mkfifo(pipe)
    noise.write_bytes(b"\xff\xfe\0")
    table.write_text("d_mm,h\n12,0.7\n")
    cut.write_bytes(images[0][:500])
    text, other = tmp_path / "text.json", tmp_path / "other.json"
    text.write_text("hello")
    other.write_text('{"d_mm": 12}')
    probe = ("--port", "socket://127.0.0.1:1", "--document")
    sweep = ("sweep", "--out", tmp_path / "s", "--design")
    for words, status, says in (
        (("simulate", "d10h08e10f10", "--out", pipe), 1, "it is a device or a directory"),
        ((*sweep, noise), 2, "cannot be read as text"),
        ((*sweep, table), 2, "lacks the columns E_ratio"),
        (("flash", cut), 2, "is cut short: 500 bytes of more than"),
        (("stream", *probe, text), 2, f"{text} is not a readable model.json"),
        (("view", *probe, text), 2, f"{text} is not a readable model.json"),
        (("view", *probe, other), 2, f"{other} cannot be used: this is not a Palpate model"),
        (("view", *probe, tmp_path), 2, f"cannot read the model {tmp_path}: is a directory"),
    ):
        got, _, err = palpate(*words)
        assert says in err and one_sentence(err)
        assert got == status
    assert pipe.is_fifo(), "a device is not replaced by a file"


def test_help_is_quick_because_nothing_heavy_is_imported():
    heavy = "numpy pandas scipy matplotlib rich serial mcap numba statsmodels"
    code = (
        "import sys; from palpate.cli import main; main(['--help']); "
        f"print([m for m in '{heavy}'.split() if m in sys.modules], file=sys.stderr)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stderr.strip() == "[]"


def test_debug_shows_the_traceback_and_keeps_the_status(palpate, monkeypatch):
    monkeypatch.setenv("PALPATE_DEBUG", "1")
    status, _, err = palpate("simulate", "nonsense")
    assert status == 2 and "Traceback" in err and "CaseError" in err


def test_simulate_prints_a_stroke_as_the_design_says(palpate, tmp_path):
    status, out, err = palpate("simulate", "d10h08e10f10", "--json", "--out", tmp_path / "s.csv")
    stroke = json.loads(out)
    assert status == 0 and err.strip() == f"wrote {tmp_path / 's.csv'}"
    n = len(stroke["positions_mm"])
    assert stroke["code"] == "d10h08e10f10" and stroke["positions_mm"][0] == -28
    assert len(stroke["displacement_mm"]) == len(stroke["images_kPa"]) == n
    assert {len(image) for image in stroke["images_kPa"]} == {len(stroke["sensors_mm"])} == {16}
    assert len(stroke["map"]["x_mm"]) == len(stroke["map"]["pressure_kPa"]) == 57
    assert stroke["cpu_s"] > 0
    assert stroke["displacement_mm"][0] == pytest.approx(2.56, rel=0.01)
    assert stroke["features"]["base_kPa"] == pytest.approx(4.0, rel=0.01)
    assert len((tmp_path / "s.csv").read_text().splitlines()) == n + 1


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_prints_a_script_for_the_shell(palpate, shell):
    status, out, _ = palpate("completion", shell)
    assert status == 0 and "_PALPATE_COMPLETE" in out and "palpate" in out


def test_completion_completes_commands():
    environment = {"_PALPATE_COMPLETE": "bash_complete", "COMP_WORDS": "palpate st", "COMP_CWORD": "1"}
    run = start_palpate(env=environment)
    out, _ = run.communicate(timeout=PATIENCE_S)
    assert "stream" in out


def test_doctor_looks_at_everything_and_says_what_to_do(palpate):
    status, out, _ = palpate("doctor", "--json")
    findings = {finding["name"]: finding for finding in json.loads(out)}
    assert {"python", "packages", "solver", "MicroPython", "browser", "port", "probe", "disk"} <= set(
        findings
    )
    assert status == (1 if any(f["state"] == "broken" for f in findings.values()) else 0)
    assert all(f["todo"] for f in findings.values() if f["state"] != "ok")


@pytest.mark.parametrize(
    "words",
    [("--help",), ("devices", "--json"), ("simulate", "d10h08"), ("doctor", "--sizes"), ("board", "x")],
)
def test_a_closed_standard_output_is_a_sentence(words, tmp_path):
    """Five of five commands ended as "unexpected"; and the next file opened would have had its number."""
    done = start_palpate(*words, cwd=tmp_path, stdout=None, prepare=lambda: os.close(1))
    with done:
        _, err = done.communicate(timeout=PATIENCE_S)
    assert done.returncode == 1
    assert one_sentence(err) and "standard output is closed" in err


def test_a_closed_standard_error_costs_nothing_but_what_is_said_there():
    with start_palpate("simulate", "d10h08", stderr=None, prepare=lambda: os.close(2)) as done:
        out, _ = done.communicate(timeout=PATIENCE_S)
    assert done.returncode == 2 and out == ""

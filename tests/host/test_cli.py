"""The command line as a user or a script meets it: exit statuses, sentences, JSON, help."""

import json
import os
import re
import signal
import subprocess
import sys

import pytest

from host.cli import cli
from host.cli.frame import CHAPTERS
from host.link import emulated as notes
from host.record.reader import Recording
from tests.host.conftest import LUMP, start_palpate
from tests.waiting import PATIENCE_S, wait_until

COMMANDS = [name for chapter in CHAPTERS.values() for name, _, _ in chapter]


def one_sentence(text: str) -> bool:
    lines = text.strip().splitlines()
    return len(lines) == 1 and lines[0].startswith("palpate: ") and "Traceback" not in text


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
    ],
)  # fmt: skip
def test_wrong_words_and_missing_things_get_one_sentence(palpate, tmp_path, words, status, says):
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
    sweep = ("sweep", "--out", tmp_path / "s", "--design")
    for words, status, says in (
        (("simulate", "d10h08e10f10", "--out", pipe), 1, "it is a device or a directory"),
        ((*sweep, noise), 2, "cannot be read as text"),
        ((*sweep, table), 2, "lacks the columns E_ratio"),
        (("flash", cut), 2, "is cut short: 500 bytes of more than"),
    ):
        got, _, err = palpate(*words)
        assert says in err and one_sentence(err)
        assert got == status
    assert pipe.is_fifo(), "a device is not replaced by a file"


def test_every_command_has_help_with_an_example(palpate):
    status, out, _ = palpate("--help")
    assert status == 0 and all(re.search(rf"^  {name} ", out, re.M) for name in COMMANDS)
    for name in COMMANDS:
        status, out, _ = palpate(name, "--help")
        assert status == 0
        assert re.search(rf"palpate {name}\b", out.split("Example")[1]), name


def test_examples_in_the_help_are_words_that_the_commands_know():
    """Every example line parses: options and arguments exist and have values of the right kind."""
    import click

    for name in COMMANDS:
        command = cli.get_command(click.Context(cli), name)
        told = f"{command.help}\n{command.epilog or ''}"
        for line in re.findall(r"^ *(palpate .+)$", told, re.M):
            words = re.split(r"\s{3,}|\s[|>]\s", line)[0].split()[1:]
            other = cli.get_command(click.Context(cli), words[0])
            other.make_context(words[0], words[1:], resilient_parsing=False)


def test_help_is_quick_because_nothing_heavy_is_imported():
    heavy = "numpy pandas scipy matplotlib rich serial mcap numba statsmodels"
    code = (
        "import sys; from host.cli import main; main(['--help']); "
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


@pytest.fixture
def flashed(emulated, images, tmp_path, palpate):
    """A probe with a model, found by `auto`."""
    device = emulated("micropython")
    notes.leave(notes.Note(device.port, os.getpid(), LUMP, "micropython"))
    image = tmp_path / "model.palp"
    image.write_bytes(images[0])
    status, out, _ = palpate("flash", image, "--json")
    assert status == 0
    return device, json.loads(out)


def test_flash_stream_replay_and_convert_through_the_command_line(flashed, palpate, tmp_path):
    _, model = flashed
    status, out, _ = palpate("devices", "--json")
    found = [d for d in json.loads(out) if d["state"] == "probe"]
    assert status == 0 and [d["model_id"] for d in found] == [model["model_id"]]
    path = tmp_path / "visit.mcap"
    status, out, err = palpate("stream", "--strokes", 2, "--record", path, "--json")
    told = json.loads(out)
    assert status == 0 and err == ""
    assert len(told["strokes"]) == 2
    for estimate in told["strokes"]:
        for name in ("F_N_per_m", "t_mm", "d_mm", "h", "E_inv23"):
            assert estimate[name]["low"] <= estimate[name]["value"] <= estimate[name]["high"]
        assert isinstance(estimate["lump"], bool) and isinstance(estimate["in_domain"], bool)
        assert estimate["hardness"] in ("hard", "soft", "unsure")
        assert estimate["level"] == 0.9 and estimate["model_id"] == model["model_id"]
    assert told["link"]["frames_lost"] == told["link"]["probe_frames_dropped"] == 0
    assert 0 < told["clock"]["uncertainty_us"] < 1_000_000
    assert Recording(path).metadata()["clock"]["offset_us"]
    status, out, _ = palpate("replay", path, "--json")
    again = json.loads(out)
    assert status == 0 and again["identical"] is True and again["compared"] == 2
    assert [s["replayed"]["d_mm"] for s in again["strokes"]] == [s["d_mm"] for s in told["strokes"]]
    status, out, _ = palpate("replay", path)
    assert status == 0 and out.splitlines()[-1].startswith("replay: identical")
    status, out, _ = palpate("convert", path, tmp_path / "visit.csv", "--json")
    assert status == 0 and json.loads(out)["estimates"] == 2


def test_settings_and_calibration_are_kept_on_the_probe(flashed, palpate):
    status, out, _ = palpate("settings", "frame_rate", 80000, "--json")
    (setting,) = json.loads(out)
    assert status == 0 and (setting["value"], setting["unit"], setting["lowest"]) == (80000, "mHz", 100)
    assert len(json.loads(palpate("settings", "--json")[1])) > 5
    status, _, err = palpate("settings", "frame_rate", 1)
    assert status == 1 and "outside its range" in err
    status, out, _ = palpate("calibrate", "zero", "--frames", 20, "--json")
    done = json.loads(out)
    assert status == 0 and done["frames"] == 20 and done["noise_counts"] >= 0
    assert palpate("calibrate", "clear")[0] == 0


def test_a_recording_that_was_tampered_with_is_found_out(flashed, palpate, tmp_path):
    """One count of one frame changed, its checksum made good again: the replay differs and says so."""
    from firmware_py import messages, wire
    from host.link.events import Frame
    from host.link.parser import LiveParser
    from host.record.replay import CALIBRATION, MODEL
    from host.record.writer import RecordingWriter

    path, changed = tmp_path / "true.mcap", tmp_path / "changed.mcap"
    assert palpate("stream", "--strokes", 1, "--record", path)[0] == 0
    parser, count = LiveParser(), 0
    with RecordingWriter(changed) as writer:
        for name in (MODEL, CALIBRATION):
            writer.attach(name, "", Recording(path).attachment(name))
        for host_ns, _, raw in Recording(path).wire():
            for event in parser.feed(raw, host_ns):
                data = parser.raw
                count += isinstance(event, Frame)
                if isinstance(event, Frame) and count == 20:
                    body, target = bytearray(700), bytearray(800)
                    place = (
                        event.seq,
                        event.time_us % messages.WRAP,
                        event.position_um,
                        event.displacement_um,
                    )
                    packed = bytes([event.packed[0] ^ 0x80, *event.packed[1:]])
                    length = messages.pack(body, messages.TYPE["frame"], 0, 0, place, packed)
                    data = bytes(target[: wire.seal(body, length, target, 0)])
                writer.received(data, event, host_ns)
    status, out, err = palpate("replay", changed)
    assert status == 1 and "DIFFERENT" in out and "differs" in err


def test_a_flipped_byte_in_a_model_image_is_refused_in_a_sentence(flashed, images, palpate, tmp_path):
    device, model = flashed
    for at in (0, 9, len(images[1]) // 2, len(images[1]) - 1):
        changed = bytearray(images[1])
        changed[at] ^= 1
        (tmp_path / "bad.palp").write_bytes(changed)
        status, out, err = palpate("flash", tmp_path / "bad.palp", "--port", device.port)
        assert status in (1, 2) and out == "" and one_sentence(err), err
    status, out, _ = palpate("devices", "--json")
    assert [d["model_id"] for d in json.loads(out) if d["port"] == device.port] == [model["model_id"]]


def test_ctrl_c_ends_a_recording_whole_and_exits_130(emulated, tmp_path):
    device, path = emulated(repeat=True), tmp_path / "stopped.mcap"
    with start_palpate("stream", "--port", device.port, "--record", path, "--json") as run:
        wait_until(lambda: path.exists() and path.stat().st_size >= 60_000, "a recording that grows")
        run.send_signal(signal.SIGINT)
        out, err = run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 130 and one_sentence(err)
    assert json.loads(out)["link"]["frames_received"] > 10
    recording = Recording(path)
    assert recording.finished and "counts" in recording.metadata()


def test_a_full_disk_ends_the_stream_at_once_with_a_sentence(emulated, tmp_path):
    import resource

    device, path = emulated(repeat=True), tmp_path / "full.mcap"
    words = ("stream", "--port", device.port, "--record", path, "--json")

    def small_disk():
        resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))

    with start_palpate(*words, prepare=small_disk) as run:
        out, err = run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 1 and out == "" and "the disk is full" in err and one_sentence(err)
    assert 50_000 < path.stat().st_size <= 60_000
    assert Recording(path).check() == ""


def test_emulate_is_found_streams_and_leaves_no_note(palpate):
    words = (
        "emulate",
        LUMP,
        "--runtime",
        "cpython",
        "--frames",
        "20",
        "--listen",
        "tcp:127.0.0.1:0",
        "--json",
    )
    with start_palpate(*words) as run:
        told = json.loads(run.stdout.readline())
        assert told["port"].startswith("socket://127.0.0.1:") and told["pid"] == run.pid
        status, out, _ = palpate("stream", "--strokes", 1)
        assert status == 0 and "no estimate" in out
        run.send_signal(signal.SIGINT)
        run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 130
    assert notes.running() == []


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

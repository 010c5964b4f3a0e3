"""The commands that talk to a probe, from flash to convert, and what ends them early."""

import json
import os
import shutil
import signal

import pytest

from palpate.link import emulated as notes
from palpate.link.flash import held_counter
from palpate.link.probe import Probe
from palpate.model_export.exporter import export
from palpate.recording.reader import Recording
from tests.host.cli.sentences import one_sentence
from tests.host.probes import LUMP
from tests.host.processes import start_palpate
from tests.waiting import PATIENCE_S, wait_until


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
    pooled = told["together"]
    assert pooled["strokes"] + pooled["left_out"] == 2 and "random effects" in pooled["how"]
    d_mm = [s["d_mm"]["value"] for s in told["strokes"]]
    assert min(d_mm) <= pooled["d_mm"]["value"] <= max(d_mm)
    assert 0 < told["clock"]["uncertainty_us"] < 1_000_000
    assert Recording(path).metadata()["clock"]["offset_us"]
    status, out, _ = palpate("replay", path, "--json")
    again = json.loads(out)
    assert status == 0 and again["identical"] is True and again["compared"] == 2
    assert [s["replayed"]["d_mm"] for s in again["strokes"]] == [s["d_mm"] for s in told["strokes"]]
    assert again["together"] == pooled
    status, out, _ = palpate("replay", path)
    assert "together, if over one lump: 2 strokes" in out
    assert status == 0 and out.splitlines()[-1].startswith("replay: identical")
    status, out, _ = palpate("convert", path, tmp_path / "visit.csv", "--json")
    assert status == 0 and json.loads(out)["estimates"] == 2


def test_strokes_of_a_probe_without_a_model_are_estimated_on_the_host(emulated, images, palpate, tmp_path):
    """As other people's arrays are: the replay had nothing to compare, and gave no number."""
    device, image, path = emulated("cpython"), tmp_path / "model.palp", tmp_path / "visit.mcap"
    image.write_bytes(images[0])
    words = ("--port", device.port, "--strokes", 1, "--record", path)
    assert palpate("stream", *words)[0] == 0
    assert "holds no model image" in palpate("replay", path)[2]
    status, out, _ = palpate("replay", path, "--model", image)
    assert status == 0 and "lump diameter d" in out and "here: the probe had none" in out
    told = json.loads(palpate("replay", path, "--model", image, "--json")[1])
    assert (told["alone"], told["compared"], told["identical"]) == (1, 0, False)
    assert told["strokes"][0]["replayed"]["valid"]


def test_settings_and_calibration_are_kept_on_the_probe(flashed, palpate):
    status, out, _ = palpate("settings", "frame_rate", 80000, "--json")
    (setting,) = json.loads(out)
    assert status == 0 and (setting["value"], setting["unit"], setting["lowest"]) == (80000, "mHz", 100)
    assert len(json.loads(palpate("settings", "--json")[1])) > 5
    status, _, err = palpate("settings", "frame_rate", 1)
    assert status == 1 and "frame_rate takes 100 to 10000000 mHz, not 1" in err
    status, _, err = palpate("calibrate", "zero", "--frames", 20)
    assert status == 1 and "the probe is in contact: lift it off" in err  # it has three frames in the air
    status, out, _ = palpate("calibrate", "zero", "--frames", 3, "--json")
    done = json.loads(out)
    assert status == 0 and done["frames"] == 3 and done["noise_counts"] >= 0
    assert palpate("calibrate", "clear")[0] == 0


def test_settings_that_were_lost_are_told_by_every_command(emulated, rotten_store, images, palpate, tmp_path):
    """The probe went on with its defaults, and nobody was told."""
    port = emulated("cpython", store=rotten_store).port
    lost = "the probe found damaged in its store: settings\n"
    image = tmp_path / "model.palp"
    image.write_bytes(images[0])
    for words in (("settings",), ("flash", image), ("calibrate", "clear"), ("stream", "--strokes", 1)):
        status, _, err = palpate(*words, "--port", port)
        assert status == 0 and err.count(lost) == 1, words
    told = json.loads(palpate("stream", "--strokes", 1, "--json", "--port", port)[1])
    assert told["probe"]["damaged"] == told["strokes"][0]["damaged"] == ["settings"]


def test_numbers_without_a_calibration_say_so(emulated, images, tmp_path, palpate):
    """They stood there like any others."""
    store = tmp_path / "store"
    device = emulated("cpython", store=store)
    image = tmp_path / "model.palp"
    image.write_bytes(images[0])
    assert palpate("flash", image, "--port", device.port)[0] == 0
    device.stop()
    for name in ("cal0", "cal1"):
        (store / name).write_bytes(b"x" * 100)
    device = emulated("cpython", store=store, calibration=None)
    status, out, err = palpate("stream", "--strokes", 1, "--port", device.port)
    assert status == 0 and "found damaged in its store: calibration" in err
    assert ("the probe has lost its calibration: do not rely on the numbers" in out) == ("diameter" in out)
    assert "diameter" in out


def test_a_recording_that_was_tampered_with_is_found_out(flashed, palpate, tmp_path):
    """One count of one frame changed, its checksum corrected: the replay differs and says so."""
    from firmware_py import messages, wire
    from palpate.recording.writer import RecordingWriter
    from palpate.stroke.replay import CALIBRATION, MODEL
    from palpate.wire.events import Frame
    from palpate.wire.parser import LiveParser

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


def test_a_rollback_reaches_what_another_home_signed_by_counter_or_by_asking_the_probe(
    emulated, specs, images, key_dir, palpate, tmp_path
):
    """A home whose clock stood at 2106 locked the others out: "export it again" could not help, nor could
    `--rollback`, which knew of its own home only."""
    elsewhere, far, model, back = (tmp_path / name for name in ("key", "far.palp", "model.json", "back.palp"))
    shutil.copytree(key_dir, elsewhere)
    far.write_bytes(export(specs[0], elsewhere, counter=43_000_000)[0])
    specs[1].save(model)
    port = emulated("micropython").port
    with Probe.open(port) as probe:
        assert held_counter(probe) == 0
    assert palpate("flash", far, "--port", port)[0] == 0
    late = tmp_path / "late.palp"
    late.write_bytes(images[1])
    status, _, err = palpate("flash", late, "--port", port)
    assert status == 1 and "with --rollback --counter 43000000" in err and one_sentence(err)
    rollback = ("export", model, "--key", key_dir, "--out", back, "--rollback", "--json")
    for reach in (("--counter", 43_000_000), ("--port", port)):
        status, out, err = palpate(*rollback, *reach)
        told = json.loads(out)
        assert status == 0 and told["replaces"] == 43_000_000 > told["counter"], err
    status, out, err = palpate("flash", back, "--port", port, "--json")
    assert status == 0 and json.loads(out)["model_id"] == told["model_id"], err
    with Probe.open(port) as probe:
        assert held_counter(probe) == 43_000_000  # and the next rollback must reach as far


def test_a_rollback_that_cannot_ask_the_probe_signs_nothing(key_dir, palpate, tmp_path):
    out = tmp_path / "back.palp"
    asking = ("--rollback", "--port", "socket://127.0.0.1:9")
    status, _, err = palpate("export", "field", "--key", key_dir, "--out", out, *asking)
    assert status == 1 and one_sentence(err) and not out.exists()


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


def test_a_probe_without_a_model_asks_to_be_flashed(key_dir):
    """With a key of one's own it said "try `palpate stream`", of a probe that could tell nothing."""
    words = ("emulate", LUMP, "--runtime", "cpython", "--frames", "30", "--strokes", "1")
    with start_palpate(*words, "--listen", "tcp:127.0.0.1:0", "--key", key_dir) as run:
        port = run.stdout.readline().strip()
        said = next(line for line in run.stderr if "Ctrl-C" in line)
        run.send_signal(signal.SIGINT)
        run.communicate(timeout=PATIENCE_S)
    assert f"palpate flash --port {port} MODEL.palp" in said and "stream" not in said


def test_emulate_is_found_streams_and_leaves_no_note(palpate):
    words = ("--runtime", "cpython", "--frames", "30", "--listen", "tcp:127.0.0.1:0", "--json")
    with start_palpate("emulate", LUMP, *words) as run:
        told = json.loads(run.stdout.readline())
        assert told["port"].startswith("socket://127.0.0.1:") and told["pid"] == run.pid
        status, out, _ = palpate("stream", "--strokes", 1)
        assert status == 0 and "lump diameter d" in out  # it has the bundled model
        run.send_signal(signal.SIGINT)
        run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 130
    assert notes.running() == []

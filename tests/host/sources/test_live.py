"""Somebody's array, live: its images are frames in kPa, and what its wire lacks is supplied and said."""

import json
import os
import subprocess
import sys
import threading

import numpy as np
import pytest
from flexitac import FlexiTacSensor

from palpate import Probe, open_recording
from palpate.cli import main
from palpate.errors import CommandRefused, PortError, UsageError
from palpate.sim.probe.endpoints import PtyEndpoint
from palpate.sources import bridge
from palpate.sources.emulated import AIR as AIR_RAW
from palpate.sources.emulated import Speaker, as_flexitac
from palpate.view.live import LiveSource
from palpate.view.notices import LinkChanged, LinkState
from palpate.wire.cells import SHAPE
from palpate.wire.events import Frame, Gap, Log, StrokeState
from tests.host.sources.arrays import AIR, flexitac, port_of, uniform
from tests.waiting import wait_until


def frames_of(probe, n, mean_kPa=-1.0):
    """The first n frames of a stream, and on until one feels so much; and what else came."""
    frames, others = [], []
    for event in probe.stream(timeout_s=60):
        (frames if isinstance(event, Frame) else others).append(event)
        if len(frames) >= n and frames[-1] is event and event.pressure_kPa.mean() > mean_kPa:
            return frames, others
    raise AssertionError(f"{len(frames)} frames of {n}")


def test_a_press_is_felt_in_frames_with_steady_times_and_no_place():
    with flexitac([AIR] * 60 + [uniform(5.0)] * 60) as speaker, Probe.open(port_of(speaker)) as probe:
        frames, others = frames_of(probe, 40, mean_kPa=5.0)
        with pytest.raises(CommandRefused):  # it would be forgotten; `palpate calibrate` keeps it
            probe.calibrate_zero()
    said = " ".join(event.text for event in others if isinstance(event, Log))
    for word in ("clock", "check sums", "guessed", "a press only", "a guess (25 kPa at full scale)"):
        assert word in said
    assert "contact" in {event.state for event in others if isinstance(event, StrokeState)}
    means = [frame.pressure_kPa.mean() for frame in frames]
    assert min(means) == pytest.approx(0.0, abs=0.02)
    assert max(means) == pytest.approx(
        25 * 235 / 255 * 0.2**0.6, abs=0.1
    )  # a straight line of what is a power
    assert {(frame.position_um, frame.displacement_um) for frame in frames} == {(0, 0)}
    assert not probe.identity.has_model and not probe.scale.calibrated


def test_their_package_and_our_source_read_one_wire():
    picture = np.linspace(0, 20, AIR.size).reshape(SHAPE)
    with flexitac([picture]) as speaker:
        with FlexiTacSensor(speaker.port, rows=SHAPE[0], cols=SHAPE[1], baseline=AIR_RAW) as theirs:
            read = theirs.read().raw
        assert np.array_equal(read.ravel(), np.frombuffer(as_flexitac(picture), np.uint8)[2:])
    with flexitac([AIR] * 50 + [picture] * 100) as speaker, Probe.open(port_of(speaker)) as probe:
        frames, _ = frames_of(probe, 10, mean_kPa=5.0)
        seen = frames[-1].pressure_kPa
    assert seen == pytest.approx((read - AIR_RAW) * (25 / 255), abs=0.01)


def test_reskin_is_read_by_its_package_and_by_us(tmp_path, capsys):
    out = tmp_path / "skin.mcap"
    done = subprocess.run(  # in a process of its own: it has another array
        [sys.executable, "-m", "tests.host.sources.skin", out],
        env={**os.environ, "PALPATE_ARRAY": "8x8@2.5mm,25kPa"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["theirs"] == pytest.approx(told["sent"], abs=1e-3)
    # a pressure of 2 kPa moves the field by 120 uT of the 2000 that stand for 25 kPa
    assert told["ours_kPa"] == pytest.approx(2 * 60 / 2000 * 25, rel=0.01)
    assert "stretched to 8 x 8" in told["said"]
    assert main(["replay", str(out)]) != 0
    assert "--array 8x8@2.5mm,25kPa" in capsys.readouterr().err


def test_a_recording_holds_what_was_streamed(tmp_path, capsys):
    out = tmp_path / "press.mcap"
    with flexitac([AIR] * 50 + [uniform(3.0)] * 50) as speaker:
        from palpate.link.session import recorded

        with recorded(port_of(speaker), out) as probe:
            frames, _ = frames_of(probe, 80)
    kept = [event for event in open_recording(out).events() if isinstance(event, Frame)]
    assert [frame.packed for frame in kept[: len(frames)]] == [frame.packed for frame in frames]
    assert main(["convert", str(out), str(tmp_path / "press.csv")]) == 0
    assert "holds no calibration" in capsys.readouterr().err
    assert main(["refine", str(out)]) == 1
    assert "its pressures are a guess until the array is calibrated" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "nothing comes: is it switched on"),
        (bytes(range(60)) * 20, "bytes came, but not the mark aa 55 in each frame: another baud rate"),
        ((b"\xaa\x55" + bytes(16 * 16)) * 9, "frames have 258 bytes, and 16 x 26 cells would take 418"),
    ],
    ids=["silent", "another baud", "wrong rows"],
)
def test_what_cannot_be_read_is_said_in_one_sentence(data, said, monkeypatch):
    monkeypatch.setattr(bridge, "FIRST_S", 0.8)
    with Speaker(PtyEndpoint(), lambda _: data, [AIR]) as speaker, pytest.raises(PortError, match=said):
        Probe.open(port_of(speaker))


def test_units_and_a_face_that_is_left_out(capsys):
    for port, said in (
        ("flexitac:/dev/null", "say rows= of the array"),
        ("flexitac:/dev/null?rows=16&cols=32&pitch=3cm", "pitch=3cm is no positive number of mm"),
        ("flexitac:/dev/null?rows=16&rows=32", "an option stands twice"),
        ("flexitac:?rows=16&cols=32&pitch=3", "names no port"),
        ("flexitack:/dev/null", "nothing here reads 'flexitack'"),
        ("flexitac:/dev/null?rows=16.5&cols=32&pitch=3", "whole numbers"),
        ("flexitac:/dev/null?rows=3&cols=3&pitch=3", "ROWS must lie between 6 and 48"),
    ):
        assert main(["stream", "--port", port]) == 2
        assert said in capsys.readouterr().err
    assert main(["emulate", "d12h07e20f09", "--as", "reskin"]) == 2
    assert "--array 8x8@2.5mm" in capsys.readouterr().err
    assert main(["--array", "16x32@3", "doctor", "--sizes"]) == 2
    assert "16x32@3mm,25kPa" in capsys.readouterr().err
    with pytest.raises(UsageError, match="PALPATE_ARRAY=16x16@2mm,25kPa"), flexitac([AIR]) as speaker:
        Probe.open(f"flexitac:{speaker.port}?rows=16&cols=16&pitch=2")


def test_an_array_that_resets_is_found_again_and_one_that_is_unplugged_is_told():
    cut = [0]

    def wire(image):
        cut[0] += 1
        data = as_flexitac(image)
        return data[:100] if cut[0] == 200 else data  # it starts again in the middle of a frame

    with Speaker(PtyEndpoint(), wire, [AIR]) as speaker, Probe.open(port_of(speaker)) as probe:
        probe.start_stream()
        events = probe.events(timeout_s=60)
        assert "slipped" in next(e.text for e in events if isinstance(e, Log) and "slipped" in e.text)
        assert next(event for event in events if isinstance(event, Frame))
        speaker.close()
        gone = next(event for event in events if isinstance(event, Gap))
    assert not gone.ended and "is gone" in gone.reason


def test_the_viewer_follows_an_array():
    seen, stop = [], threading.Event()
    with flexitac([AIR] * 60 + [uniform(5.0)] * 60) as speaker:
        source = LiveSource(port_of(speaker))
        follower = threading.Thread(target=source.run, args=(seen.append, stop))
        follower.start()
        wait_until(lambda: sum(isinstance(event, Frame) for event in seen) > 20, lambda: seen[-3:])
        stop.set()
        follower.join()
    links = [each for each in seen if isinstance(each, LinkChanged)]
    assert links[0].state is LinkState.CONNECTED and links[0].device.model_id == ""

"""Places from a second source: an encoder on another port, or a camera's table; gaps are said."""

import numpy as np
import pytest

from palpate import Probe, open_recording
from palpate.cli import main
from palpate.errors import PortError
from palpate.link.session import recorded
from palpate.sim.probe.endpoints import PtyEndpoint
from palpate.sources import bridge
from palpate.sources.emulated import Speaker
from palpate.sources.encoder import PlaceSource
from palpate.wire.events import Frame, Log
from tests.host.sources.arrays import AIR, flexitac, port_of, uniform

SPEED_MM_PER_S = 20.0


class Lines:
    """A port on which these lines wait."""

    def __init__(self, *pieces):
        self.pieces = list(pieces)

    def read(self, timeout_s):
        return self.pieces.pop(0) if self.pieces else b""


def encoder_of(*pieces, every_us=10_000.0):
    encoder = PlaceSource("lines", Lines(*pieces))
    for k in range(len(pieces)):
        encoder.look(k * every_us)
    return encoder


def test_places_go_straight_between_lines_and_on_for_a_moment():
    encoder = encoder_of(b"0 1\n", b"1.0, 2", b".0\n", b"2 3\n")
    assert encoder.at(5_000.0) == pytest.approx((0.25, 1.25))  # the second line was whole at 20 ms
    assert encoder.at(40_000.0) == pytest.approx((3.0, 4.0))
    assert encoder.at(2e5) == pytest.approx((2 + 5.0, 3 + 5.0))  # it goes on for 50 ms, then it stands
    assert (encoder.lines, encoder.without) == (3, 0)
    encoder.at(5e5)
    assert encoder.without == 1


def test_lines_that_are_no_places_are_counted_and_one_is_wanted():
    encoder = encoder_of(b"x=3\nnan\n1e9\n\n", b"\xff\xfe\n")
    assert encoder.odd == 5 and encoder.lines == 0
    with pytest.raises(PortError, match="5 lines came, and none is a place in mm"):
        encoder.check()
    with pytest.raises(PortError, match="no line; send lines as"):
        encoder_of().check()


def test_an_encoder_on_another_port_gives_frames_their_places():
    """It falls silent for a while: the frames keep the last place, and how many is told.

    A busy machine may starve the encoder before that; then silence is told more than once.
    """
    silent = []

    def line(mm):
        return b"" if silent else f"{mm:.3f},{mm / SPEED_MM_PER_S:.3f}\n".encode()

    with (
        flexitac([AIR] * 10 + [uniform(5.0)] * 90) as speaker,
        Speaker(PtyEndpoint(), line, np.arange(0, 5000, SPEED_MM_PER_S / 100), rate_Hz=100) as second,
        Probe.open(port_of(speaker, position=second.port)) as probe,
    ):
        moved, kept, said, told = [], [], "", 0
        for event in probe.stream(timeout_s=60):
            if isinstance(event, Log):
                said += event.text + "; "
            elif isinstance(event, Frame):
                (kept if told else moved).append(event)
            known = said.rfind("places again") >= said.rfind("no places")
            if len(moved) >= 60 and known and not silent:
                silent.append(said.count("no places"))
            if silent and said.count("no places") > silent[0]:
                told = told or len(said)
            if told and len(kept) == 10:
                break
        silent.clear()
        for event in probe.stream(timeout_s=60):
            if isinstance(event, Log):
                said += event.text + "; "
            if told and "places again" in said[told:]:
                break
    assert f"places and depths are of {second.port}" in said
    assert f"no places from {second.port}: frames keep the last" in said
    assert "frames had none of their own" in said
    place = np.array([frame.position_mm for frame in moved])
    depth = np.array([frame.displacement_mm for frame in moved])
    assert place[-1] > place[0]
    assert depth == pytest.approx(place / SPEED_MM_PER_S, abs=0.003)
    assert len({frame.position_mm for frame in kept}) == 1


def test_an_encoder_that_says_nothing_of_places_is_refused(monkeypatch):
    monkeypatch.setattr(bridge, "FIRST_S", 0.8)
    with (
        flexitac([AIR]) as speaker,
        Speaker(PtyEndpoint(), lambda _: b"hello\n", [0.0]) as second,
        pytest.raises(PortError, match="none is a place in mm"),
    ):
        Probe.open(port_of(speaker, position=second.port))


@pytest.fixture(scope="module")
def press(tmp_path_factory):
    """A recorded press without places."""
    out = tmp_path_factory.mktemp("recorded") / "press.mcap"
    with flexitac([AIR] * 20 + [uniform(5.0)] * 400) as speaker, recorded(port_of(speaker), out) as probe:
        for count, event in enumerate(probe.stream(timeout_s=60)):
            if count > 120 and isinstance(event, Frame):
                break
    return out


def test_a_camera_s_table_gives_a_recording_its_places(press, tmp_path, capsys):
    times_s = [t for t in np.arange(0, 1.5, 0.02) if not 0.5 < t < 0.9]
    rows = "".join(f"{t:.3f},{25 * t:.3f},{1 + t:.3f}\n" for t in times_s)
    track = tmp_path / "track.csv"
    track.write_text("time_s,position_mm,displacement_mm\n" + rows)
    words = ["import", str(press), "--position", str(track), "--out", str(tmp_path / "joined")]
    assert main(words) == 0
    said = capsys.readouterr().err
    assert "no places for 0.4" in said and "frames lie before or after all places" in said
    with open_recording(tmp_path / "joined" / "press.mcap") as session:
        frames = [event for event in session.events() if isinstance(event, Frame)]
        assert session.recording.metadata()["session"]["port"].startswith("flexitac:")
        assert session.recording.attachment("calibration.bin") is None  # nor had it one before
    time_s = np.array([frame.time_us for frame in frames]) / 1e6
    place = np.array([frame.position_mm for frame in frames])
    moving = (place > 0.5) & (place < 35)
    assert np.polyfit(time_s[moving], place[moving], 1)[0] == pytest.approx(25, rel=0.01)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time_s,x\n0,1\n1,2\n", "has no column position_mm; it has time_s, x"),
        ("time_s,position_mm\n0,1\n1,far\n", "row 2, position_mm: no number"),
        ("time_s,position_mm\n0,1\n0,2\n", "row 2, time_s: time does not go on"),
        ("time_s,position_mm\n900,1\n901,2\n", "places from 900.0 to 901.0 s, the recording lasts from 0 to"),
        ("time_s,position_mm\n0,1\n", "holds 1 places"),
        ("", "is no table"),
    ],
)
def test_a_table_that_does_not_fit_gets_one_sentence(press, tmp_path, capsys, text, said):
    track = tmp_path / "track.csv"
    track.write_text(text)
    assert main(["import", str(press), "--position", str(track), "--out", str(tmp_path / "joined")]) == 2
    err = capsys.readouterr().err
    assert said in err and "Traceback" not in err

"""The owner's road of docs/howto/your-own-array.md: calibrate a FlexiTac, record a press, refine it."""

import json

import pytest

from palpate import open_recording
from palpate.cli import main
from palpate.inversion.recorded import felt_strokes
from palpate.sources.emulated import felt_in_presses, felt_under_a_cuff
from palpate.wire.events import StrokeState
from tests.host.sources.arrays import flexitac, port_of

CODE, SEED = "d12h05e10f09", 3


def said(capsys, *words):
    """What a command prints as JSON."""
    assert main([*words, "--json"]) == 0, capsys.readouterr().err
    return json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A press over a lump, felt by an array before and after it was calibrated with a cuff."""
    home = tmp_path_factory.mktemp("owner")
    cuffs = {kPa: felt_under_a_cuff(CODE, "typical", SEED, kPa) for kPa in (0.0, 2.0, 5.0, 12.0)}
    presses = felt_in_presses(CODE, "typical", SEED, 2, 0.0)
    with flexitac(cuffs[0.0]) as speaker:
        port = port_of(speaker, radius="40mm", keep=home / "mine.json")

        def record(name):
            speaker.show([*cuffs[0.0], *presses])
            words = ["--seconds", "6", "--record", str(home / name), "--json"]
            assert main(["stream", "--port", port, *words]) == 0

        record("before.mcap")
        speaker.show(cuffs[0.0])
        assert main(["calibrate", "zero", "--port", port]) == 0
        for kPa in (2.0, 5.0, 12.0):
            speaker.show(cuffs[kPa])
            assert main(["calibrate", "gain", "--pressure", str(kPa), "--port", port]) == 0
        speaker.show(cuffs[0.0])
        record("after.mcap")
    return home


@pytest.mark.long
def test_a_calibrated_press_gives_an_estimate_with_intervals(recorded, capsys):
    capsys.readouterr()
    found = said(capsys, "refine", str(recorded / "after.mcap"), "--class", "border")
    one = found["strokes"][0]
    assert one["press"] and one["fits"] and one["class"] == "border", one
    for name, true in (("d_mm", 12.0), ("depth_mm", 6.0), ("t_mm", 12.0), ("E_fat_kPa", 10.0)):
        assert one[name]["low"] < true < one[name]["high"], (name, one[name])


def test_guessed_pressures_and_a_face_that_is_not_described_are_refused(recorded, tmp_path, capsys):
    assert main(["refine", str(recorded / "before.mcap")]) == 1
    assert "its pressures are a guess until the array is calibrated" in capsys.readouterr().err
    path = recorded / "after.mcap"
    with open_recording(path) as session:
        states = {event.state for event in session.events() if isinstance(event, StrokeState)}
        assert states == {"contact", "lifted"}
    (felt, start), *_ = felt_strokes(path)
    assert felt.alone and felt.face.radius_mm == 40.0 and not felt.measured
    assert 7 < start.E_kPa < 16 and abs(start.lump_mm) < 3

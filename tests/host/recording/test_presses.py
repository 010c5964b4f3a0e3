"""A replay feels the press before a stroke as the probe did."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from firmware_py import calib, feature_names, features
from palpate import models
from palpate.errors import ImageUnreadable
from palpate.features import press_features
from palpate.importing.firmware import ImportedSession
from palpate.link import emulator_model as emulator
from palpate.model_export import exporter, image_builder
from palpate.model_export.image_builder import inspect
from palpate.model_export.vocabulary import ABSENT
from palpate.recording import channels
from palpate.recording.playback import open_recording
from palpate.recording.writer import RecordingWriter
from palpate.sim.probe.over_lump import strokes_over
from palpate.sim.probe.sensors import LEVELS, PRESS_FRAMES, SensorModel, StrokeField
from palpate.stroke.replay import replay
from palpate.wire.events import Estimate, Features
from tests.firmware_py import press_float
from tests.firmware_py.strokes import read_strokes
from tests.host.probes import LUMP

OF_THE_PRESS = press_features.PLACES
BEFORE = Path(__file__).with_name("before_the_press.mcap")
"""Made by the release before the press was looked at: 16 frames of press, 40 of a stroke."""


@pytest.fixture(scope="module")
def stream():
    noise = LEVELS["typical"].without("dead")  # the calibration of `recorded` knows of no dead cells
    return SensorModel(StrokeField(*read_strokes()[1]), noise, 4).stroke(60, press=24)


def recorded(path, *streams, lift=True, image=None):
    """The firmware's session while these are felt, one after the other."""
    image = image or emulator.image(models.TOLD)
    with RecordingWriter(path) as writer:
        nominal = calib.Calibration().to_bytes()
        writer.attach(channels.CALIBRATION, "application/octet-stream", nominal)
        writer.attach(channels.MODEL, "application/octet-stream", image)
        session = ImportedSession(writer, inspect(image), 1_700_000_000_000_000_000)
        now = 0
        for k, one in enumerate(streams):
            if lift or k == 0:
                session.lifted(now, int(one.positions_um[0]))
            now += 10_000
            for packed, x, d in zip(one.packed, one.positions_um, one.displacements_um):
                now += 26_667
                session.frame(packed, int(x), int(d), now)
            if not lift:  # it stands still until the stroke counts as ended
                for _ in range(2):
                    now += 1_100_000
                    session.frame(packed, int(x), int(d), now)
        session.lifted(now + 10_000, int(one.positions_um[-1]))
        session.end()
    return path


def told(path):
    with open_recording(path) as session:
        return [np.array(e.values) / 2**24 for e in session.events() if isinstance(e, Features)]


def test_the_probe_looks_at_the_press_and_the_replay_is_the_same_to_the_bit(stream, tmp_path):
    path = recorded(tmp_path / "a.mcap", stream)
    (values,) = told(path)
    assert values[features.PRESS] == pytest.approx(
        press_float.at_parts(
            press_float.curves(stream.counts[:24], stream.displacements_um[:24] / 1e3),
            values[feature_names.NAMES.index("ln_force")],
        )[0],
        abs=0.03,
    )
    assert [(s.identical, s.features_equal) for s in replay(path)] == [(True, True)]


@pytest.mark.parametrize("hang", [0.0, 0.02])
def test_a_stroke_that_follows_without_lifting_has_the_same_press(hang, tmp_path):
    """The frame that ended a stroke by standing still was counted, not felt, and the replay was another.

    Of cells that hang the first stroke had mended the press for good, and the replay was another again.
    """
    noise = LEVELS["typical"].with_(stuck=hang)
    field = StrokeField(*read_strokes()[1])
    stream, back = SensorModel(field, noise, 4).stroke(60, press=24), SensorModel(field, noise, 4).stroke(60)
    path = recorded(tmp_path / "a.mcap", stream, back, lift=False)
    first, second = told(path)
    assert (second[OF_THE_PRESS] > ABSENT).all()
    assert second[OF_THE_PRESS] == pytest.approx(first[OF_THE_PRESS], abs=0.1)
    assert [s.identical for s in replay(path)] == [True, True]


def test_a_stroke_after_lifting_has_its_own_press_or_none(stream, tmp_path):
    bare = SensorModel(StrokeField(*read_strokes()[1]), LEVELS["typical"], 4).stroke(60)
    path = recorded(tmp_path / "a.mcap", stream, bare)
    first, second = told(path)
    assert (first[OF_THE_PRESS] > ABSENT).all()
    assert (second[OF_THE_PRESS] == ABSENT).all()
    assert [s.identical for s in replay(path)] == [True, True]


def test_a_recording_of_a_probe_that_did_not_look_at_the_press_is_read_and_its_model_refused_by_name():
    """Its model says nothing of the fat: an image of another format, which this firmware cannot run."""
    (values,) = told(BEFORE)
    assert len(values) == features.PRESS
    with pytest.raises(ImageUnreadable, match=r"format version 4.*own estimates stay as they are"):
        list(replay(BEFORE))


def test_where_the_models_press_is_missing_the_replay_says_so(stream, tmp_path, monkeypatch):
    path = recorded(tmp_path / "a.mcap", stream)
    monkeypatch.setattr("palpate.stroke.session_frames._Presses.of", lambda *_: None)
    (stroke,) = replay(path)
    assert "press" in stroke.missing and not stroke.identical, "its checks look at it"
    spec = dataclasses.replace(models.load(models.TOLD), checks=None)
    tables, _, force_map = exporter.prepare(spec)
    blind = image_builder.build(spec, tables, force_map, counter=1)
    (other,) = replay(recorded(tmp_path / "b.mcap", stream, image=blind))
    assert other.identical, "without checks it does not"
    with open_recording(path) as session:
        assert any(isinstance(e, Estimate) for e in session.events())


def test_an_emulated_probe_is_pressed_before_it_strokes_and_its_stroke_is_the_same(tmp_path):
    (bare,), _ = strokes_over(LUMP, "none", 1, 40, press=False)
    (pressed,), _ = strokes_over(LUMP, "none", 1, 40, 1, press=True)
    assert pressed.press == PRESS_FRAMES and pressed.packed[PRESS_FRAMES:] == bare.packed
    path = recorded(tmp_path / "a.mcap", pressed)
    (values,) = told(path)
    depths = values[OF_THE_PRESS][:3]
    assert depths[2] == pytest.approx(np.log(bare.displacements_um[0] / 1e3), abs=0.03)
    assert (np.diff(depths) > 0.3).all(), "it goes deeper as the force doubles"
    assert [s.identical for s in replay(path)] == [True]

"""The whole chain: as exact as its reference, indifferent to how the stroke was made, never out of range."""

import numpy as np
import pytest

from firmware_py import calib, feature_names, features, forcemap, status
from palpate.firmware_twin.replay_core import Replay
from palpate.model_export.vocabulary import OF_THE_COLUMNS
from palpate.sim.probe.sensors import LEVELS, SensorModel, pack
from tests.firmware_py import pipeline_features as field_features
from tests.firmware_py.stages import replayed, watched


def in_float64(frames, model, fitted_map):
    x_mm, displacements_mm = frames.positions_um / 1e3, frames.displacements_um / 1e3
    return field_features.compute(frames.counts, x_mm, displacements_mm, model.calibration(), fitted_map)


def test_within_a_fifth_of_a_percent_of_float64_on_200_strokes(fields, replay, fitted_map):
    worst = dict.fromkeys(feature_names.NAMES, 0.0)
    n = 0
    for i, field in enumerate(fields):
        for seed in range(20):
            level = ("none", "good", "typical", "poor")[seed % 4]
            model = SensorModel(field, LEVELS[level], 100 * i + seed)
            frames, code = replayed(replay, model)
            assert code == status.OK
            true = in_float64(frames, model, fitted_map)
            assert tuple(replay.pipeline.span) == true.columns
            assert replay.pipeline.place_um / 1e3 == pytest.approx(true.place_mm, abs=0.05)
            for name, got in zip(feature_names.NAMES, replay.features()):
                if name not in OF_THE_COLUMNS:
                    worst[name] = max(worst[name], abs(got - true.features[name]))
            n += 1
    assert n == 200
    # .2 % of the quantity under a logarithm, of the pressure or displacement that a ratio is made of; of the
    # bump for the misfit, which is a thousandth of it
    misfit = worst.pop("ln_misfit")
    assert misfit < 0.05
    assert {k: v for k, v in worst.items() if v > 2e-3} == {}


def test_how_a_bump_is_spread_across_is_told_to_a_fiftieth_of_its_best_columns(fields, replay, fitted_map):
    """Columns' maps are rounded to an eighth of a count, and are all alike where a lump runs right across."""
    off, found = [], {}
    for i, field in enumerate(fields):
        for across_mm in (2.5, 3.9, 6.0):
            model = SensorModel(field, LEVELS["typical"], i, across_mm=across_mm)
            frames, _ = replayed(replay, model)
            true = in_float64(frames, model, fitted_map)
            of_true = [true.features[name] for name in OF_THE_COLUMNS]
            off.append(np.abs(replay.features()[features.ACROSS : features.ACROSS_END] - of_true))
            found.setdefault(across_mm, []).append(of_true)
    assert np.max(off) < 0.02
    # the wider, the more of it columns further off see
    narrow, middling, wide = (np.median(of, axis=0) for of in found.values())
    assert (narrow < middling).all() and (middling < wide).all()


@pytest.mark.parametrize("level", ["none", "typical"])
def test_compiled_plain_and_watched_give_the_same_integers(fields, map_blob, level):
    slow, watch = watched(map_blob)
    fast, plain = Replay(map_blob), Replay(map_blob, plain=True)
    for i, field in enumerate(fields[:4]):
        model = SensorModel(field, LEVELS[level], i, across_mm=3.9 if i % 2 else None)
        frames, code = replayed(fast, model)
        assert plain.stream(frames, model.calibration()) == slow.stream(frames, model.calibration()) == code
        for name in ("features", "map", "fit", "span", "columns", "profile"):
            expected = list(getattr(plain.pipeline, name))
            assert list(getattr(fast.pipeline, name)) == expected, name
            assert list(getattr(slow.pipeline, name)) == expected, name
    assert watch.most > 2**28


def garbage(rng, kind):
    """Frames that no probe would send, but a broken one might."""
    n = int(rng.integers(2, 120))
    counts = {
        "noise": rng.integers(0, 4096, (n, 416)),
        "full": np.full((n, 416), 4095),
        "empty": np.zeros((n, 416), int),
        "flicker": rng.integers(0, 2, (n, 1)) * 4095 * np.ones((1, 416), int),
        "cells": rng.integers(0, 2, (n, 416)) * 4095,
    }[kind]
    x = np.linspace(-45_000, 45_000, n) + rng.normal(0, 3000, n)
    d = rng.integers(-131_071, 131_072, n)
    return counts, x.astype(int) + int(rng.integers(-(2**28), 2**28)), d


@pytest.mark.parametrize("kind", ["noise", "full", "empty", "flicker", "cells"])
def test_no_frames_whatever_lead_out_of_range(kind, map_blob):
    replay, _ = watched(map_blob)
    force_map = replay.force_map
    rng = np.random.default_rng(11)
    c = calib.Calibration()
    for k in range(3):
        for i in range(calib.CELLS):
            c.gain[i] = int(rng.choice([0, 8192, 32767]))
            c.offset[i] = int(rng.choice([0, 655, 32767]))
        counts, x, d = garbage(rng, kind)
        replay.force_map = None if k == 1 else force_map
        replay.stroke(map(pack, counts), x, d, c)
        assert all(abs(v) < 2**29 for v in replay.pipeline.features)


def test_a_force_map_of_extreme_numbers_stays_in_range(fields):
    rng = np.random.default_rng(3)
    frames = SensorModel(fields[0], LEVELS["poor"], 1).stroke()
    for extreme in (-32768, 32767, None):
        blob = bytearray([0x46, forcemap.VERSION, 12, 0, *bytes(4), 1, 0, 0, 0])
        for _ in range(forcemap.COEFS):
            v = int(rng.integers(-32768, 32768)) if extreme is None else extreme
            blob += (v & 65535).to_bytes(2, "little")
        replay, _ = watched(bytes(blob))
        assert replay.force_map is not None
        replay.stream(frames)


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_all_200_strokes_stay_in_range(fields, map_blob):
    """The strokes of the accuracy test, and as many over balls, every intermediate watched."""
    slow, watch = watched(map_blob)
    fast = Replay(map_blob)
    for i, field in enumerate(fields):
        for seed in range(20):
            level = ("none", "good", "typical", "poor")[seed % 4]
            for across in (None, 3.9):
                model = SensorModel(field, LEVELS[level], 100 * i + seed, across_mm=across)
                frames, code = replayed(fast, model)
                assert slow.stream(frames, model.calibration()) == code
                assert list(slow.pipeline.features) == list(fast.pipeline.features)
    print(f"largest intermediate: {watch.most} at {watch.where}")
    assert 2**29 < watch.most < 2**30

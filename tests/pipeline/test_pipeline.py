"""The whole chain: as exact as its reference, indifferent to how the stroke was made, never out of range."""

import math

import numpy as np
import pytest

from firmware_py import bins, calib, features, forcemap, pipeline, status
from host import field_features
from host.replay_core import Replay
from sim.probe.sensors import LEVELS, Noise, SensorModel, pack
from tests.pipeline import checked_int

# .2 % of a feature: of the quantity under a logarithm, of the pressure or displacement a ratio is made of
LOGARITHMS = [n for n in features.NAMES if n.startswith(("ln_", "asinh_"))]
RATIOS = [n for n in features.NAMES if n not in LOGARITHMS]


def replayed(replay, model, n_frames=50, **kwargs):
    frames = model.stroke(n_frames, **kwargs)
    code = replay.stream(frames, model.calibration())
    return frames, code


def test_within_a_fifth_of_a_percent_of_float64_on_200_strokes(fields, replay, fitted_map):
    worst = dict.fromkeys(features.NAMES, 0.0)
    n = 0
    for i, field in enumerate(fields):
        for seed in range(20):
            level = ("none", "good", "typical", "poor")[seed % 4]
            model = SensorModel(field, LEVELS[level], 100 * i + seed)
            frames, code = replayed(replay, model)
            assert code == status.OK
            true = field_features.compute(
                frames.counts,
                frames.positions_um / 1e3,
                frames.displacements_um / 1e3,
                model.calibration(),
                fitted_map,
            )
            assert tuple(replay.pipeline.span) == true.columns
            assert replay.pipeline.place_um / 1e3 == pytest.approx(true.place_mm, abs=0.05)
            for name, got in zip(features.NAMES, replay.features(), strict=True):
                worst[name] = max(worst[name], abs(got - true.features[name]))
            n += 1
    assert n == 200
    # the misfit is a thousandth of the bump; the .2 % are of the bump
    misfit = worst.pop("ln_misfit")
    assert misfit < 0.05
    assert {k: v for k, v in worst.items() if v > 2e-3} == {}


@pytest.mark.parametrize("level", ["none", "typical"])
def test_compiled_plain_and_watched_give_the_same_integers(fields, map_blob, level):
    watched, watch = checked_int.load()
    slow = watched.pipeline.Pipeline(calib.Calibration())
    fast, plain = Replay(map_blob), Replay(map_blob, plain=True)
    for i, field in enumerate(fields[:4]):
        model = SensorModel(field, LEVELS[level], i, across_mm=3.9 if i % 2 else None)
        frames, code = replayed(fast, model)
        assert plain.stream(frames, model.calibration()) == code
        slow.reset()
        slow.calibration = model.calibration()
        for k, packed in enumerate(frames.packed):
            slow.add_frame(packed, int(frames.positions_um[k]), int(frames.displacements_um[k]))
        assert slow.finish(forcemap.load(map_blob)) == code
        for name in ("features", "map", "fit", "span", "columns", "profile"):
            expected = list(getattr(plain.pipeline, name))
            assert list(getattr(fast.pipeline, name)) == expected, name
            assert list(getattr(slow, name)) == expected, name
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
    watched, _ = checked_int.load()
    rng = np.random.default_rng(11)
    c = calib.Calibration()
    p = watched.pipeline.Pipeline(c)
    for k in range(3):
        for i in range(calib.CELLS):
            c.gain[i] = int(rng.choice([0, 8192, 32767]))
            c.offset[i] = int(rng.choice([0, 655, 32767]))
        counts, x, d = garbage(rng, kind)
        p.reset()
        for j in range(len(x)):
            p.add_frame(pack(counts[j]), int(x[j]), int(d[j]))
        p.finish(None if k == 1 else forcemap.load(map_blob))
        assert all(abs(v) < 2**29 for v in p.features)


def test_a_force_map_of_extreme_numbers_stays_in_range(fields):
    watched, _ = checked_int.load()
    rng = np.random.default_rng(3)
    p = watched.pipeline.Pipeline(calib.Calibration())
    frames = SensorModel(fields[0], LEVELS["poor"], 1).stroke()
    for extreme in (-32768, 32767, None):
        blob = bytearray([0x46, forcemap.VERSION, 12, 0, *bytes(8)])
        for _ in range(forcemap.COEFS):
            v = int(rng.integers(-32768, 32768)) if extreme is None else extreme
            blob += (v & 65535).to_bytes(2, "little")
        p.reset()
        for k, packed in enumerate(frames.packed):
            p.add_frame(packed, int(frames.positions_um[k]), int(frames.displacements_um[k]))
        p.finish(watched.forcemap.load(bytes(blob)))


def feature(replay, name):
    return replay.features()[features.NAMES.index(name)]


def test_direction_and_origin_do_not_matter(fields, map_blob):
    """A stroke to the left, read by an encoder that starts anywhere, is the same stroke."""
    replay = Replay(map_blob)
    noise = Noise(start_mm=5)
    frames = SensorModel(fields[0], noise, 4).stroke()
    x, d = frames.positions_um, frames.displacements_um
    assert replay.stroke(frames.packed, x, d) == status.OK
    forward, place = replay.features(), replay.pipeline.place_um
    assert replay.stroke(frames.packed[::-1], x[::-1] - 123_456_789, d[::-1]) == status.OK
    assert replay.pipeline.place_um + 123_456_789 == pytest.approx(place, abs=1000)
    assert replay.features() == pytest.approx(forward, abs=0.02)
    # carried out the other way round over a symmetric lump: mirrored images at mirrored places
    mirrored = [pack(c.reshape(16, 26)[::-1]) for c in frames.counts]
    assert replay.stroke(mirrored, -x, d) == status.OK
    assert replay.features() == pytest.approx(forward, abs=0.02)


def clear(fields, replay):
    """The lumps whose bump is over 4 % of the base."""
    out = []
    for field in fields:
        replay.stream(SensorModel(field, Noise(), 1).stroke())
        if math.sinh(feature(replay, "asinh_amp")) > 4:
            out.append(field)
    assert len(out) >= 4
    return out


# just enough to keep 26 equal columns from being rounded alike
FAINT = Noise(gain=0.01)


@pytest.mark.parametrize("n_frames", [40, 80, 160])
def test_the_frame_rate_hardly_matters(fields, map_blob, n_frames):
    """Cubic traces: Amp and Stdev do not shrink or grow with the spacing of the frames."""
    replay = Replay(map_blob)
    for field in clear(fields, replay):
        model = SensorModel(field, FAINT, 1)
        replay.stream(model.stroke(50))
        usual = replay.features()
        replay.stream(model.stroke(n_frames))
        got = replay.features()
        for name, by in (("ln_base", 0.002), ("ln_stdev", 0.03), ("asinh_amp", 0.03), ("ln_d_far", 0.002)):
            i = features.NAMES.index(name)
            assert got[i] == pytest.approx(usual[i], abs=by), name


def test_uneven_speed_and_a_pause_do_not_matter(fields, map_blob):
    replay = Replay(map_blob)
    model = SensorModel(clear(fields, replay)[0], FAINT, 1)
    replay.stream(model.stroke(50))
    usual = replay.features()
    t = np.linspace(0, 1, 90)
    path = np.concatenate(
        [40 * np.sin(np.pi * (t[:45] - 0.5)), np.full(40, 0.3), 40 * np.sin(np.pi * (t[45:] - 0.5))]
    )
    packed, x, d = [], [], []
    for place in path:
        counts, position, depth = model.counts_at(float(place))
        packed.append(pack(counts))
        x.append(position)
        d.append(depth)
    assert replay.stroke(packed, x, d) == status.OK
    assert feature(replay, "asinh_amp") == pytest.approx(usual[features.NAMES.index("asinh_amp")], abs=0.03)
    assert feature(replay, "ln_stdev") == pytest.approx(usual[features.NAMES.index("ln_stdev")], abs=0.02)


def test_the_force_map_undoes_a_wandering_hand(fields, map_blob):
    still, wandering = Noise(), Noise(force=0.1)
    with_map, without = Replay(map_blob), Replay()
    undone, left = [], []
    for i, field in enumerate(fields):
        model = SensorModel(field, still, i)
        with_map.stream(model.stroke())
        without.stream(model.stroke())
        a, b = with_map.features(), without.features()
        shaken = SensorModel(field, wandering, i).stroke()
        with_map.stream(shaken)
        without.stream(shaken)
        undone.append(with_map.features() - a)
        left.append(without.features() - b)
    for name in ("asinh_amp", "ln_stdev", "dip_6_10", "asinh_rise", "trace_12_16"):
        i = features.NAMES.index(name)
        size = [float(np.sqrt(np.median(np.square(v), axis=0))[i]) for v in (undone, left)]
        assert size[0] < size[1] / 5, name


@pytest.mark.parametrize("level", ["none", "typical"])
def test_all_columns_for_a_cylinder_about_six_for_a_ball(fields, replay, level):
    rng = np.random.default_rng(2)
    for i, field in enumerate(clear(fields, replay)):
        replayed(replay, SensorModel(field, LEVELS[level], i))
        assert list(replay.pipeline.span) == [0, 26]
        across = rng.uniform(-12, 12)
        replayed(replay, SensorModel(field, LEVELS[level], i, across_mm=3.9, across_centre_mm=across))
        first, last = replay.pipeline.span
        assert 4 <= last - first <= 9
        assert 1.5 * ((first + last - 1) / 2 - 12.5) == pytest.approx(across, abs=1.6)


def test_a_ball_seen_by_its_own_columns_is_not_diluted(fields, map_blob):
    own, every = Replay(map_blob), Replay(map_blob, fixed_columns=(0, 26))
    frames = SensorModel(fields[0], Noise(), 1, across_mm=3.9).stroke()
    own.stream(frames)
    every.stream(frames)
    assert math.sinh(feature(own, "asinh_amp")) > 2.5 * math.sinh(feature(every, "asinh_amp"))


def test_known_dead_cells_cost_little(fields, map_blob):
    replay = Replay(map_blob)
    replay.stream(SensorModel(fields[0], Noise(), 1).stroke())
    whole = replay.features()
    model = SensorModel(fields[0], Noise(dead=0.1), 1)
    replayed(replay, model)
    assert replay.features() == pytest.approx(whole, abs=0.03)


def test_cells_that_died_since_the_calibration_are_found_and_mended(fields, map_blob, fitted_map):
    replay = Replay(map_blob)
    replay.stream(SensorModel(fields[0], FAINT, 1).stroke())
    whole = replay.features()
    model = SensorModel(fields[0], FAINT.with_(dead=0.05, dead_unknown=0.5), 1)
    frames, code = replayed(replay, model)
    assert code == status.OK
    assert replay.pipeline.stuck == int((model.dead & ~model.known_dead).sum()) > 5
    assert replay.features() == pytest.approx(whole, abs=0.03)
    given = frames.counts, frames.positions_um / 1e3, frames.displacements_um / 1e3
    true = field_features.compute(*given, model.calibration(), fitted_map)
    assert replay.features() == pytest.approx(list(true.features.values()), abs=5e-3)


def test_no_lump_is_no_lump(flat_field, replay):
    """Nothing that rises, or so little of it that the model's lump rule turns it down."""
    for seed in range(10):
        model = SensorModel(flat_field, LEVELS["typical"], seed)
        _, code = replayed(replay, model)
        assert code in (status.OK, status.NO_FIT)
        amp = math.sinh(feature(replay, "asinh_amp")) / 100
        assert amp < 0.01 or feature(replay, "ln_stdev") > math.log(20)


def test_a_short_or_broken_stroke_is_refused(fields, map_blob):
    replay = Replay(map_blob)
    short = SensorModel(fields[0], Noise(), 1, travel_mm=40).stroke()
    assert replay.stream(short) == status.TOO_SHORT
    frames = SensorModel(fields[0], Noise(), 1).stroke()
    keep = [k for k in range(50) if not 20 <= k < 27]
    code = replay.stroke(
        [frames.packed[k] for k in keep], frames.positions_um[keep], frames.displacements_um[keep]
    )
    assert code == status.TOO_SHORT
    assert replay.stroke([], [], []) == status.TOO_SHORT


def test_frames_that_cannot_be_used_say_so(fields):
    p = pipeline.Pipeline(calib.Calibration())
    frame = bytes(calib.FRAME_BYTES)
    assert p.add_frame(frame[:-1], 0, 0) == status.BAD_LENGTH
    assert p.add_frame(frame, 2**29, 0) == status.BAD_VALUE
    assert p.add_frame(frame, 0, 2**17) == status.BAD_VALUE
    assert p.bins.frames == 0
    for _ in range(16):
        assert p.add_frame(frame, 700, 100) == status.OK
    assert p.add_frame(frame, 700, 100) == bins.IGNORED
    assert p.add_frame(frame, 700 + 96_000, 100) == bins.BEYOND
    assert p.add_frame(frame, 700 + 94_000, 100) == status.OK
    assert p.add_frame(frame, 700 - 3_000, 100) == bins.BEYOND
    assert p.finish() == status.TOO_SHORT
    assert p.add_frame(frame, 700, 100) == status.BAD_STATE
    p.reset()
    assert p.add_frame(frame, 700, 100) == status.OK


def test_finish_can_be_asked_again_with_another_force_map(fields, map_blob):
    frames = SensorModel(fields[0], LEVELS["typical"], 1).stroke()
    with_map, without = Replay(map_blob), Replay()
    with_map.stream(frames)
    without.stream(frames)
    p = without.pipeline
    assert p.finish(forcemap.load(map_blob)) == status.OK
    assert list(p.features) == list(with_map.pipeline.features)

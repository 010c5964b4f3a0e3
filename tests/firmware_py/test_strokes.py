"""A stroke is a stroke however it is made: direction, speed, force, columns, dead cells; or it is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest

from firmware_py import bins, calib, feature_names, features, forcemap, gauss, geometry, pipeline, status
from palpate.features import press_features
from palpate.firmware_twin.replay_core import Replay
from palpate.sim.probe.sensors import LEVELS, Noise, SensorModel, pack
from palpate.wire.cells import FULL_SCALE_KPA
from tests.benchmarks.bench_refused import RisingForce
from tests.firmware_py import pipeline_features as field_features
from tests.firmware_py.stages import replayed


def feature(replay, name):
    return replay.features()[feature_names.NAMES.index(name)]


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
            i = feature_names.NAMES.index(name)
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
    assert feature(replay, "asinh_amp") == pytest.approx(
        usual[feature_names.NAMES.index("asinh_amp")], abs=0.03
    )
    assert feature(replay, "ln_stdev") == pytest.approx(
        usual[feature_names.NAMES.index("ln_stdev")], abs=0.02
    )


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
        i = feature_names.NAMES.index(name)
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
    replay = Replay(map_blob)
    replay.stream(SensorModel(fields[0], Noise(), 1, across_mm=3.9).stroke())
    p = replay.pipeline
    assert p.fit[gauss.AMP] / 2**11 > 2.5 * np.mean(p.columns) / 2**3


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


def true_features(model, frames, fitted_map):
    """The same stroke, with its press, in float64."""
    n = frames.press
    given = frames.counts, frames.positions_um / 1e3, frames.displacements_um / 1e3
    press = given[0][:n], given[2][:n]
    stroke = (part[n:] for part in given)
    return field_features.compute(*stroke, model.calibration(), fitted_map, press=press).features


@pytest.mark.parametrize("level", ["good", "typical"])
def test_cells_that_hang_anywhere_are_found_in_the_stroke_and_taken_out_of_the_press(
    fields, map_blob, fitted_map, level
):
    """Only cells at a rail were found: of 0.5 % of the cells F's intervals held 67 %, E_fat's 77 %."""
    replay = Replay(map_blob)
    for seed, field in enumerate(clear(fields, replay)[:4]):
        noise = LEVELS[level].with_(start_mm=0.0)
        whole = SensorModel(field, noise, seed)
        assert replayed(replay, whole, press=24)[1] == status.OK
        assert replay.pipeline.stuck == 0
        wanted = replay.features()
        model = SensorModel(field, noise.with_(stuck=0.02), seed)
        frames, code = replayed(replay, model, press=24)
        assert code == status.OK and 3 < replay.pipeline.stuck <= model.stuck.sum()
        assert replay.features() == pytest.approx(wanted, abs=0.05)
        true = true_features(model, frames, fitted_map)
        named = dict(zip(feature_names.NAMES, replay.features()))
        for name in press_features.NAMES:
            assert named[name] == pytest.approx(true[name], abs=0.02), name


def test_two_strokes_after_one_press_and_each_replayed_by_itself_say_the_same(fields, map_blob):
    """The first stroke mended the press for good; a replay of the second mended it anew, by other cells."""
    replay, again = Replay(map_blob), Replay(map_blob)
    for seed, field in enumerate(fields[:3]):
        model = SensorModel(field, LEVELS["typical"].with_(stuck=0.02), seed)
        first, second = model.stroke(press=24), model.stroke()
        assert replay.stream(first, model.calibration()) == status.OK and replay.pipeline.stuck
        p = replay.pipeline
        felt = list(p.press.kept)
        p.reset()
        for packed, x, d in zip(second.packed, second.positions_um, second.displacements_um, strict=True):
            p.add_frame(packed, int(x), int(d))
        assert p.finish(replay.force_map) == status.OK and p.stuck
        assert list(p.press.kept) == felt
        n = first.press
        press = first.packed[:n], first.displacements_um[:n]
        alone = replace(
            second,
            press=n,
            packed=[*press[0], *second.packed],
            positions_um=np.r_[first.positions_um[:n], second.positions_um],
            displacements_um=np.r_[press[1], second.displacements_um],
        )
        assert again.stream(alone, model.calibration()) == status.OK
        assert list(again.pipeline.features) == list(p.features)


@pytest.mark.parametrize("level", ["none", "good", "typical", "poor"])
def test_live_cells_do_not_hang_however_lightly_they_are_pressed(fields, flat_field, map_blob, level):
    replay = Replay(map_blob)
    for seed, field in enumerate([*fields, flat_field] * 3):
        across_mm, n = (3.9 if seed % 2 else None), (50, 400)[seed % 3 == 0]
        replayed(replay, SensorModel(field, LEVELS[level], seed, across_mm=across_mm), n)
        assert replay.pipeline.stuck == 0


@pytest.mark.parametrize("rise", [-0.2, 0.1, 0.2])
def test_a_press_lighter_than_the_stroke_tells_nothing_of_its_tissue(fields, map_blob, rise):
    """Of a force that rises by 20 % to either side the press shows four fifths; t was covered to 82 %."""
    replay = Replay(map_blob)
    for seed, field in enumerate(fields[:4]):
        model = RisingForce(field, LEVELS["typical"].without("start_mm", "drift", "offset"), seed)
        model.rise = rise
        replay.stream(model.stroke(press=24), model.calibration())
        told = feature(replay, "press_d_full") > features.ABSENT / 2**24
        assert told == (rise < 0.15)


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
    assert code == status.TOO_SPARSE
    assert replay.stroke([], [], []) == status.TOO_SHORT


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("past_mm", [36, 28, 20, 15])
def test_a_stroke_that_ends_too_soon_past_the_lump_is_refused(fields, map_blob, past_mm, back):
    """The search kept off the stroke's ends and the fit went there: at 15 mm sizes were confidently wrong."""
    replay = Replay(map_blob)
    for field in fields[:4]:
        frames = SensorModel(field, LEVELS["typical"].with_(start_mm=0.0), 1).stroke()
        kept = np.flatnonzero(np.linspace(-40, 40, 50) <= past_mm)
        kept = 49 - kept if back else kept
        code = replay.stroke(
            [frames.packed[k] for k in kept], frames.positions_um[kept], frames.displacements_um[kept]
        )
        assert code == (status.OK if past_mm > 24 else status.TOO_SHORT)


@pytest.mark.parametrize(("frames", "code"), [(16, status.TOO_SPARSE), (25, status.OK)])
def test_a_stroke_of_few_frames_is_refused(fields, map_blob, frames, code):
    """With 16 frames the intervals of h held 62 % of the truths, and nothing said so."""
    replay = Replay(map_blob)
    for seed, field in enumerate(fields[:4]):
        assert replay.stream(SensorModel(field, LEVELS["typical"], seed).stroke(frames)) == code


@pytest.mark.parametrize(("rise", "code"), [(0.1, status.OK), (0.25, status.OK), (0.45, status.UNEVEN)])
def test_a_stroke_of_uneven_force_is_refused(fields, map_blob, rise, code):
    """A force that rose by 40 % to either side passed, and the intervals of t held 30 % of the truths."""
    replay = Replay(map_blob)
    for seed, field in enumerate(fields[:4]):
        model = RisingForce(field, LEVELS["typical"].with_(start_mm=0.0), seed)
        model.rise = rise
        assert replay.stream(model.stroke()) == code


@pytest.mark.parametrize(("top", "code"), [(0.9, status.OK), (1.25, status.SATURATED)])
def test_a_stroke_whose_bump_reaches_beyond_full_scale_is_refused(fields, map_blob, top, code):
    """Its top was cut off, and no flag was set."""
    replay = Replay(map_blob)
    for seed, field in enumerate(fields[:4]):
        model = SensorModel(field, LEVELS["typical"], seed)
        highest = model.pressures_at(np.linspace(-40, 40, 81))[0].max()
        model.gain *= top * FULL_SCALE_KPA / highest
        assert replay.stream(model.stroke()) == code


def test_a_few_cells_that_hang_at_full_scale_do_not_refuse_a_stroke(fields, map_blob):
    replay = Replay(map_blob)
    model = SensorModel(fields[0], LEVELS["typical"], 3)
    frames = model.stroke()
    frames.counts[:, [17, 200, 201, 390]] = geometry.FULL_COUNT
    frames = replace(frames, packed=[pack(c) for c in frames.counts])
    assert replay.stream(frames, model.calibration()) == status.OK


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
    assert p.add_frame(frame, 700 + bins.BINS * bins.WIDTH_UM, 100) == bins.BEYOND
    assert p.add_frame(frame, 700 + (bins.BINS - 1) * bins.WIDTH_UM - 500, 100) == status.OK
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


@pytest.mark.parametrize(("n_bins", "width_um"), [(7, 1500), (256, 500), (64, 50), (64, 4000)])
def test_bins_that_the_integers_cannot_hold_are_refused(n_bins, width_um):
    with pytest.raises(ValueError, match="bins of"):
        pipeline.Pipeline(calib.Calibration(), n_bins, width_um)


def test_wider_and_fewer_bins_still_give_the_stroke(fields, map_blob):
    """Half the memory: 32 bins of 3 mm; the bump is smoothed, but found."""
    usual, coarse = Replay(map_blob), Replay(map_blob, n_bins=32, width_um=3000)
    frames = SensorModel(fields[0], FAINT, 1).stroke()
    assert usual.stream(frames) == coarse.stream(frames) == status.OK
    assert coarse.features() == pytest.approx(usual.features(), abs=0.6)
    assert abs(coarse.pipeline.place_um - usual.pipeline.place_um) <= 2000

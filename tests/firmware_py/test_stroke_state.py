"""What the probe tells while a stroke goes on."""

import pytest

from firmware_py import messages, settings, stroke_state
from palpate.sim.probe.sensors import StrokeField, stroke_frames
from palpate.sim.tissue import Case, Settings, simulate_forces


def field(case):
    return StrokeField(*simulate_forces(case, [case.F_rel, 1.4 * case.F_rel], Settings(far_start_mm=-44.0)))


@pytest.fixture(scope="module")
def lump():
    return field(Case.from_code("d12h08e10f10"))


@pytest.fixture(scope="module")
def healthy():
    return field(Case.without_lump(16.0))


def told(stream, changes=None, step_us=20_000):
    """The states told along a stroke, with what stood beside them."""
    values = settings.Settings().values
    for key, value in (changes or {}).items():
        values[key] = value
    watch = stroke_state.StrokeState(values)
    air = bytes([82, 32, 5]) * 208
    said = []
    frames = [
        (air, int(stream.positions_um[0])),
        *zip(stream.packed, map(int, stream.positions_um)),
        (air, 0),
    ]
    for k, (packed, position) in enumerate(frames):
        events = watch.update(packed, position, k * step_us & (1 << 30) - 1)
        for state in messages.STATES:
            if events >> state & 1:
                said.append((state, watch.lump_um))
    return said


@pytest.mark.parametrize("level", ["good", "typical", "poor"])
def test_a_stroke_over_a_lump_is_told_from_contact_to_lifting(lump, level):
    for seed in range(6):
        stream = stroke_frames(lump, level, seed)
        said = told(stream)
        states = [state for state, _ in said if state not in (messages.STATE_TOO_FAST,)]
        assert states == [
            messages.STATE_CONTACT,
            messages.STATE_STARTED,
            messages.STATE_LUMP_PASSED,
            messages.STATE_ENDED,
            messages.STATE_LIFTED,
        ]
        place_mm = next(lump_um for state, lump_um in said if state == messages.STATE_LUMP_PASSED) / 1000
        assert place_mm == pytest.approx(stream.truth.centre_mm, abs=6)


def test_healthy_tissue_under_a_steady_hand_has_no_lump_to_pass(healthy):
    for seed in range(6):
        states = [state for state, _ in told(stroke_frames(healthy, "good", seed))]
        assert messages.STATE_LUMP_PASSED not in states
        assert messages.STATE_ENDED in states


def test_force_and_speed_out_of_range_are_told_once(lump):
    stream = stroke_frames(lump, "none")
    assert [s for s, _ in told(stream)].count(messages.STATE_FORCE_HIGH) == 0
    for key, value, state in (
        (settings.FORCE_HIGH, 50_000, messages.STATE_FORCE_HIGH),
        (settings.FORCE_LOW, 900_000, messages.STATE_FORCE_LOW),
        (settings.SPEED_LIMIT, 10_000, messages.STATE_TOO_FAST),
    ):
        assert [s for s, _ in told(stream, {key: value})].count(state) == 1


def test_standing_still_ends_a_stroke(lump):
    stream = stroke_frames(lump, "none")
    stream.packed[25:] = [stream.packed[25]] * 25
    stream.positions_um[25:] = stream.positions_um[25]
    said = [s for s, _ in told(stream, {settings.STROKE_PAUSE: 200})]
    assert said.index(messages.STATE_ENDED) < said.index(messages.STATE_LIFTED)
    assert said.count(messages.STATE_ENDED) == 1

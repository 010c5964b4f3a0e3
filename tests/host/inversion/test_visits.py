"""Two visits to one lump: what they share drops out, and what has changed is told with its own interval."""

import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from palpate.inversion.changing import changing
from palpate.inversion.classes import ANYWHERE
from palpate.inversion.forward import COARSE
from palpate.inversion.joint import Together
from palpate.inversion.visits import TwoVisits, invert_visits
from palpate.sim.probe.noise import level_named
from palpate.sim.tissue import Case
from tests.host.inversion.solid_world import felt_over
from tests.host.inversion.test_inversion import PALPATE, a_few_frames, check_jacobian, record, refined
from tests.host.inversion.test_solids import BALL, emulated, without_solver
from tests.host.inversion.world import felt_of


def test_the_jacobian_of_two_visits_is_their_misfit_s_derivative():
    """Of tissue that both share, of the change that only the second feels, and of gains in common."""
    rng = np.random.default_rng(7)
    of = changing(ANYWHERE)
    parts, own = zip(*(a_few_frames(of, rng) for _ in range(2)))
    both = Together(parts, ("gain",))
    forward = TwoVisits(of, ANYWHERE, COARSE, *([part.stroke] for part in parts))
    z = both.joined(own)
    z[both.at["tissue"]][-2:] = 0.1, -0.05
    assert both.size == 2 * parts[0].size - len(of.unknowns) - 1 - 16

    # between so few frames what a force does at its neighbours' places is not followed
    check_jacobian(both, forward, z, rng, within=0.1)


@pytest.mark.long
def test_a_lump_that_grew_is_told_more_narrowly_than_from_two_answers(tmp_path):
    """By one probe, in another hand, with other zeros; the visits' own answers are kept, and compared."""
    case = Case(11.0, 0.6, 8.0, 0.55, fat_stiffening=1.0, gland_stiffening=1.0)
    grown = replace(case, d_mm=12.3, h=(6.6 - 0.65) / 12.3)
    paths = [tmp_path / "january.mcap", tmp_path / "may.mcap"]
    for path, now, seed in zip(paths, (case, grown), (5, 6)):
        _, _, stream, calibration = felt_of(now, seed, probe=5)
        record(stream, calibration, path)
    assert refined(*paths).returncode == 0
    found = {}
    for words in (["--refine"], ["--model", "anywhere"]):
        done = subprocess.run([PALPATE, "compare", *paths, *words, "--json"], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        found |= json.loads(done.stdout)
    assert found["fits"], found
    joint, apart = found["ratio"]["d_mm"], found["refined_apart"]["d_mm"]
    assert joint["low"] < 12.3 / 11.0 < joint["high"] and joint["low"] > 1.0
    assert np.log(joint["high"] / joint["low"]) < 0.7 * np.log(apart["high"] / apart["low"])


def test_a_ball_that_grew_is_told_as_a_change(monkeypatch):
    """Two visits to balls were refused; the second stroke's line lies 2 mm beside the first one's."""
    without_solver(monkeypatch)
    noise = level_named("typical")
    grown = replace(BALL, d_mm=13.5, h=6.45 / 13.5, offset_mm=2.0)
    before, after = (felt_over(*emulated(case), seed, probe=4)[:2] for case, seed in ((BALL, 4), (grown, 5)))
    change = invert_visits([before], [after], noise)
    assert change.fits, change
    assert change.ratio["d_mm"].low < 13.5 / 12.0 < change.ratio["d_mm"].high
    assert change.ratio["depth_mm"].low < 6.45 / 7.2 < change.ratio["depth_mm"].high
    assert change.before.values["d_mm"].value < change.after.values["d_mm"].value
    visits = (visit.values["d_mm"] for visit in (change.before, change.after))
    apart = np.hypot(*(np.log(value.high / value.low) for value in visits))
    assert np.log(change.ratio["d_mm"].high / change.ratio["d_mm"].low) < 0.3 * apart

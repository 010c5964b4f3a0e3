"""A press beside the lump joins what the stroke's own press says, unless it is of another place."""

from array import array

import numpy as np
import pytest

from firmware_py import features, outputs
from palpate.learn import reference
from palpate.learn.observed import observe_in_any_fat
from palpate.learn.reference import fit_joining
from palpate.model_export.integers import compiler
from palpate.sim.tissue import Case
from palpate.sim.tissue.any_tissue import PRESS_PARTS, press_cases, without_its_lump
from tests import reference_model
from tests.studies import reference as reference_study

N, Q24 = 400, 1 << 24
ENDS = np.array([*reference_model.ENDS.values()]).T


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """Two lumps of the design, and presses beside them."""
    home = tmp_path_factory.mktemp("any")
    return home, reference_study.prepare(home, 2, workers=1)


def pairs(seed=1):
    """What presses and references might say of n tissues: both err, partly alike."""
    rng = np.random.default_rng(seed)
    truth = rng.normal([1.5, 2.7, 3.0], 0.3, (N, 3))
    alike = rng.normal(0, 0.02, (N, 3))
    return truth + alike + rng.normal(0, 0.06, (N, 3)), truth + alike + rng.normal(0, 0.03, (N, 3)), truth


def test_the_surer_of_two_weighs_more_and_both_together_err_less_than_either():
    own, other, truth = pairs()
    joining = fit_joining(own, other, truth)
    assert ((joining.weights > 0.7) & (joining.weights < 0.9)).all()
    error = [
        np.sqrt(np.mean((x - truth) ** 2)) for x in (joining.joined(own, other, always=True), own, other)
    ]
    assert error[0] < min(error[1:])


def test_so_many_good_references_as_was_said_are_left_out_and_others_are_found():
    own, other, truth = pairs()
    joining = fit_joining(own, other, truth, false_alarms=0.02)
    own, other, _ = pairs(seed=2)
    assert 1 - joining.fits(own, other).mean() == pytest.approx(0.02, abs=0.02)
    off = other + np.array([0.0, np.log(1.5), 0.0])
    assert joining.fits(own, off).mean() < 0.05
    kept = joining.joined(own, off)[~joining.fits(own, off)]
    assert np.array_equal(kept, own[~joining.fits(own, off)])


def test_the_probe_joins_them_as_the_fit_does():
    own, other, truth = pairs()
    joining = fit_joining(own, other, truth)
    first = compiler.compile_first(reference_model.model(joining.data()).first)
    at = features.COUNT
    for mine, theirs in zip(own[:50], other[:50]):
        x = array("i", [0] * at + [round(v * Q24) for v in mine])
        first.set(*(round(v * Q24) for v in theirs))
        flag = first.refer(x)
        (wanted,), (fits,) = joining.joined(mine[None], theirs[None]), joining.fits(mine[None], theirs[None])
        distance = joining.distance(mine[None], theirs[None])[0]
        if abs(distance / joining.limit - 1) > 0.05:  # the probe has fewer bits
            assert flag == (outputs.REFERENCE if fits else outputs.REFERENCE_OFF)
            assert np.array(x[at:]) / Q24 == pytest.approx(np.clip(wanted, *ENDS), abs=2e-4)


def test_the_tissue_beside_a_lump_is_the_same_without_it():
    lumps, plain = press_cases(4, 5), reference_study.reference_cases(4, 5)
    for lump, beside in zip(lumps[:: len(PRESS_PARTS)], plain[:: len(reference_study.PARTS)], strict=True):
        assert not beside.has_lump
        assert reference.tissue_of(lump) == reference.tissue_of(beside)
    thicker = reference_study.elsewhere_cases(4, 5, 0.1)[len(reference_study.PARTS)]
    assert thicker.t_mm == pytest.approx(1.1 * lumps[len(PRESS_PARTS)].t_mm)
    assert without_its_lump(Case.from_code("d10h08e10f10_ball")).solid


def test_a_reference_is_seen_by_the_strokes_probe_in_the_strokes_fat(few):
    home, lumps = few
    found = reference.read_references(home / "reference")
    taken = reference.observe_references(lumps, found, "typical", 1)
    again = reference.observe_references(lumps, found, "typical", 1)
    seen = observe_in_any_fat(lumps, "typical", 1, None)
    assert taken.taken.all() and np.array_equal(taken.press, again.press)
    assert taken.ln_force == pytest.approx(seen.of("ln F"), abs=0.25)
    assert taken.press == pytest.approx(seen.press, abs=0.35)
    none = reference.observe_references(lumps, {}, "typical", 1)
    assert not none.taken.any()

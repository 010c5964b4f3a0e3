"""Checks learn what a model's strokes are not, and leave those alone that are."""

import numpy as np
import pytest

from palpate.learn.checks import fit_checks, joined
from palpate.model_export.integers.reference import estimates

NAMES = ("asinh_amp", "ln_stdev", "ln_misfit", "asinh_rise", "trace_7_9", "tilt_3_5")


def strokes(n, seed, strange=False):
    """Six features on a curved sheet of three numbers; strange ones lie beside it, each within its range."""
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=(3, n))
    bent = a * b + 0.3 * c + (0.8 if strange else 0.0)
    X = np.column_stack([a, b, c, bent, a - b, b + c]) + 0.05 * rng.normal(size=(n, 6))
    return X, np.arange(n) // 2


@pytest.fixture(scope="module")
def checks():
    X, groups = strokes(1200, 1)
    return fit_checks(NAMES, X, groups, {"two_lumps": strokes(400, 2, strange=True)}, 0.02, most_features=5)


def above(checks, X):
    return estimates(checks, X[:, [NAMES.index(n) for n in checks.features]])[:, 0] > 0


def test_strange_strokes_are_told_apart_where_each_feature_alone_says_nothing(checks):
    known, strange = strokes(2000, 3)[0], strokes(2000, 4, strange=True)[0]
    lo, hi = np.quantile(known, [0.005, 0.995], axis=0)
    assert ((strange >= lo) & (strange <= hi)).all(axis=1).mean() > 0.8
    assert above(checks, strange).mean() > 0.95


def test_few_of_the_models_own_are_left_out(checks):
    assert above(checks, strokes(4000, 5)[0]).mean() == pytest.approx(0.02, abs=0.015)


def test_few_features_are_kept_and_the_one_that_tells_among_them(checks):
    assert len(checks.features) == 5 and "asinh_rise" in checks.features


def test_each_kind_has_a_check_of_its_own():
    X, groups = strokes(600, 1)
    low = strokes(300, 6)
    low[0][:, 3] -= 0.8
    both = fit_checks(NAMES, X, groups, {"two_lumps": strokes(300, 2, True), "other": low})
    assert [e.name for e in both.estimates] == ["two_lumps", "other"]
    high, under = (estimates(both, x[:, [NAMES.index(n) for n in both.features]]) > 0
                   for x in (strokes(500, 7, True)[0], low[0]))  # fmt: skip
    assert high[:, 0].mean() > 0.9 and under[:, 1].mean() > 0.9


def test_checks_of_other_features_stand_beside_and_change_nothing(checks):
    """As the press's do: a stroke that begins pressed is judged by the others."""
    X, groups = strokes(600, 1)
    low = strokes(300, 6)
    low[0][:, 3] -= 0.8
    names = tuple(f"press_{name}" for name in NAMES)
    both = joined(checks, fit_checks(names, X, groups, {"other": low}))
    assert [e.name for e in both.estimates] == ["two_lumps", "other"]
    mine, theirs = strokes(500, 7)[0], low[0]
    rows = np.column_stack([mine[:300], theirs])[:, [(*NAMES, *names).index(n) for n in both.features]]
    values = estimates(both, rows)
    own = estimates(checks, mine[:300, [NAMES.index(n) for n in checks.features]])
    assert values[:, 0] == pytest.approx(own[:, 0], abs=1e-12)
    assert (values[:, 1] > 0).mean() > 0.9


def test_a_check_that_learns_how_far_tells_little_from_much_sooner():
    """Fitted to 1 everywhere, it spends its terms on making little and much the same."""
    rng = np.random.default_rng(8)
    X, groups = strokes(1200, 1)

    def off(n, seed, far):
        found, lumps = strokes(n, seed)
        found[:, 3] += 0.5 * far
        return found, lumps

    far = rng.uniform(0.6, 3.0, 600)
    kinds = {"other": off(600, 9, far)}
    by_amount = fit_checks(NAMES, X, groups, kinds, 0.005, how_far={"other": far})
    plain = fit_checks(NAMES, X, groups, kinds, 0.005)
    little = off(500, 10, np.full(500, 0.8))[0]
    noticed = [above(checks, little).mean() for checks in (by_amount, plain)]
    assert noticed[0] > noticed[1] and noticed[0] > 0.95

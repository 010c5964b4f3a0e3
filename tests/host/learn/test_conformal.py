"""Widths of intervals and edges of a domain, each against what can be reckoned by hand."""

import numpy as np
import pytest

from palpate.learn import conformal, domain


def test_the_size_of_an_error_is_found_from_features_and_predictions_alike():
    rng = np.random.default_rng(7)
    n = 3000
    z = rng.uniform(-1, 1, (n, 2))
    predicted = np.column_stack([z[:, 0] + rng.normal(2.0, 0.7, n), rng.normal(-1.0, 0.3, n)])
    true = np.exp(np.column_stack([0.3 + 0.5 * z[:, 0] - 0.4 * predicted[:, 0], -2.0 + 0.8 * z[:, 1]]))
    residual = true * rng.choice([-1.0, 1.0], (n, 2))
    terms, coefficients = conformal.fit_sigma(z, predicted, residual, np.arange(n))
    widths = conformal.Widths(terms, coefficients, np.array([[1.0, 2.0], [3.0, 5.0]]), 0.9)
    said, inner = widths.sigma(z, predicted), np.abs(residual) > np.quantile(np.abs(residual), 0.15, axis=0)
    assert said[inner] == pytest.approx(true[inner], rel=0.15)
    hard = z[:, 0] > 0.2
    np.testing.assert_allclose(widths.half(z, predicted, hard)[hard], said[hard] * [2.0, 5.0])
    np.testing.assert_allclose(widths.half(z, predicted, hard)[~hard], said[~hard] * [1.0, 3.0])


def test_an_error_of_nothing_makes_no_interval_of_nothing():
    rng = np.random.default_rng(8)
    z = rng.normal(size=(400, 1))
    residual = rng.normal(size=(400, 1))
    residual[::11] = 0.0
    terms, coefficients = conformal.fit_sigma(z, z, residual, np.arange(400))
    sigma = conformal.Widths(terms, coefficients, np.ones((1, 2)), 0.9).sigma(z, z)
    assert sigma.min() > 0.2 and sigma.max() < 1.2


def test_no_lump_is_predicted_by_a_fit_that_has_seen_it():
    rng = np.random.default_rng(9)
    groups = rng.integers(0, 40, 300) * 7
    Y = groups[:, None].astype(float)
    sizes = []

    def fit(z, Y, groups):
        known = set(groups.tolist())
        sizes.append(len(known))
        return lambda new: np.array([[float(lump in known)] for lump in new[:, 0]])

    out = conformal.out_of_fold(groups[:, None].astype(float), Y, groups, fit)
    assert not out.any()
    assert len(sizes) == conformal.CROSS_FOLDS and set(sizes) == {35}, "each with seven eighths of the lumps"


def calibrated(n=2000, level=0.9, groups=(), wrong=None):
    rng = np.random.default_rng(11)
    z = rng.normal(size=(n, 1))
    predicted = rng.normal(size=(n, 1))
    hard = rng.random(n) < 0.3
    error = np.where(hard, 3.0, 1.0) * rng.standard_normal(n)
    if wrong is not None:
        error = np.where(wrong(n), 1.07, 1.0) * error
    terms = conformal.all_terms(1, 1)
    flat = np.zeros((len(terms) + 1, 1))
    truth = predicted + error[:, None]
    parts = [part(n) for part in groups]
    return (
        conformal.calibrate(terms, flat, z, predicted, truth, hard, level, parts),
        error,
        hard,
        z,
        predicted,
    )


@pytest.mark.parametrize("level", [0.8, 0.9])
def test_soft_and_hard_have_a_quantile_of_their_own_and_no_more_than_is_asked(level):
    widths, error, hard, z, predicted = calibrated(level=level)
    for side in (False, True):
        size = np.sort(np.abs(error[hard == side]))
        least = next(k for k in range(len(size)) if (k + 1) / (len(size) + 1) >= level)
        assert widths.half(z, predicted, hard)[hard == side] == pytest.approx(size[least])
    assert widths.level == level


def every_fifth(n):
    return np.arange(n) % 5 == 0


def test_a_part_that_holds_too_seldom_widens_the_intervals_as_far_as_is_allowed_and_not_further():
    plain, *_ = calibrated()
    wider, error, hard, z, predicted = calibrated(groups=[every_fifth], wrong=every_fifth)
    held = np.abs(error) <= wider.half(z, predicted, hard)[:, 0]
    assert held[every_fifth(len(held))].mean() >= conformal.WORST_GROUP - 0.003
    assert held.mean() <= conformal.MOST + 0.005
    assert (wider.quantiles >= plain.quantiles * 0.97).all()


def test_what_cannot_be_evened_out_is_met_by_a_higher_quantile(monkeypatch):
    monkeypatch.setattr(conformal, "evened", lambda _terms, coefficients, *_: coefficients)
    plain, *_ = calibrated(wrong=every_fifth)
    wider, error, hard, z, predicted = calibrated(groups=[every_fifth], wrong=every_fifth)
    before, after = (np.abs(error) <= one.half(z, predicted, hard)[:, 0] for one in (plain, wider))
    part = every_fifth(len(error))
    assert before[part].mean() < conformal.WORST_GROUP <= after[part].mean()
    assert (wider.quantiles > plain.quantiles).all() and after.mean() <= conformal.MOST + 0.005


def test_a_part_that_nothing_helps_does_not_make_all_other_intervals_wide(monkeypatch):
    """They are widened as far as to the quantile of MOST, whatever that part still lacks."""
    monkeypatch.setattr(conformal, "evened", lambda _terms, coefficients, *_: coefficients)
    monkeypatch.setattr(conformal, "WORST_GROUP", 0.99)  # more than any part of few strokes can have
    widths, error, hard, z, predicted = calibrated(groups=[worst_of_all], wrong=worst_of_all)
    held = np.abs(error) <= widths.half(z, predicted, hard)[:, 0]
    assert held[worst_of_all(len(held))].mean() < conformal.WORST_GROUP
    assert held.mean() <= conformal.MOST + 0.005


def worst_of_all(n):
    return np.arange(n) % 50 == 0


def test_a_part_has_a_quantile_of_its_own_only_where_it_has_strokes_enough():
    score = np.arange(1.0, 201.0)
    for size, own in ((conformal.FEWEST - 1, False), (conformal.FEWEST, True)):
        part = np.arange(200) < size
        wanted = conformal.conformal_quantile(score[part] if own else score, 0.9)
        assert conformal.quantile_of_part(score, part, 0.9) == wanted


@pytest.mark.parametrize("n", [1, 5, 9, 10, 19, 57, 99])
@pytest.mark.parametrize("level", [0.5, 0.8, 0.9, 0.95])
def test_the_quantile_is_the_first_score_that_holds_the_level_of_n_and_the_fresh_one(n, level):
    score = np.random.default_rng(n).permutation(np.arange(1.0, n + 1))
    enough = [k for k in range(1, n + 1) if k / (n + 1) >= level - 1e-12]
    assert conformal.conformal_quantile(score, level) == (enough[0] if enough else n)


def test_of_no_score_at_all_nothing_follows():
    assert conformal.conformal_quantile(np.array([]), 0.9) == 0.0


def edge():
    return domain.DomainCheck(
        np.array([-1.0, -2.0]), np.array([1.0, 2.0]),
        np.array([0.5, 0.0]), np.array([[4.0, 1.0], [1.0, 1.0]]),
        2.0, np.array([0.0, -np.inf, 3.0]), np.array([1.0, 5.0, np.inf]), 0.5,
    )  # fmt: skip


def test_the_distance_is_a_mahalanobis_distance_and_box_and_threshold_belong_to_the_domain():
    check = edge()
    z = np.array([[0.5, 0.0], [1.0, 0.0], [0.5, 1.0], [1.0, -1.0], [0.0, 1.0]])
    np.testing.assert_allclose(check.distance(z), [0, 1, 1, 1, 1])
    far = np.array([[0.5 + np.sqrt(0.5), 0.0], [0.5 + np.sqrt(0.5) + 1e-6, 0.0]])
    inside = np.zeros((2, 2))
    assert check.familiar(inside, far).tolist() == [True, False]
    for features, known in (([1, 2], True), ([-1, -2], True), ([1.001, 0], False), ([0, -2.001], False)):
        assert check.familiar(np.array([features], float), z[:1]).tolist() == [known]


def test_an_estimate_counts_by_how_many_half_widths_its_worst_output_lies_beyond_its_range():
    check, half = edge(), np.array([[0.2, 2.0, 1.0]])
    for y, beyond in (
        ([0.5, 0.0, 4.0], -1.0),
        ([1.09, 0.0, 9.0], 0.45),
        ([-0.12, 0.0, 9.0], 0.6),
        ([0.5, 5.98, 9.0], 0.49),
        ([0.5, -99.0, 2.2], 0.8),
        ([0.5, 7.0, 2.9], 1.0),
    ):
        assert check.beyond(np.array([y]), half)[0] == pytest.approx(beyond)
        kept = check.inside(np.zeros((1, 2)), np.array([[0.5, 0.0]]), np.array([y]), half)
        assert kept[0] == (beyond <= 0.5)
    assert not check.inside(np.array([[3.0, 0.0]]), np.array([[0.5, 0.0]]), np.array([[0.5, 0, 4]]), half)[0]


@pytest.mark.parametrize("share", [0.01, 0.1])
def test_the_domain_is_so_much_wider_than_what_was_seen(share):
    rng = np.random.default_rng(12)
    z = rng.normal(size=(4000, 2)) @ np.array([[2.0, 0.3], [0.0, 0.5]])
    features = z * [10.0, 0.1] + [5.0, -3.0]
    check = domain.fit_domain(features, z, 3, share)
    lo, hi = (np.quantile(features, q, axis=0) for q in (share / 8, 1 - share / 8))
    np.testing.assert_allclose(check.lo, lo - 0.05 * (hi - lo))
    np.testing.assert_allclose(check.hi, hi + 0.05 * (hi - lo))
    np.testing.assert_allclose(check.centre, z.mean(0))
    exact = np.einsum("ni,ij,nj->n", z - z.mean(0), np.linalg.inv(np.cov(z.T)), z - z.mean(0))
    np.testing.assert_allclose(check.distance(z), exact, rtol=0.02)
    assert check.threshold == pytest.approx(1.2 * np.quantile(exact, 1 - share / 2), rel=0.01)
    assert np.isinf(check.range_lo).all() and np.isinf(check.range_hi).all() and len(check.range_lo) == 3
    assert check.beyond(np.zeros((1, 3)), np.ones((1, 3)))[0] == -np.inf, "ranges without ends"


def test_without_being_told_it_leaves_out_one_stroke_in_forty_less_what_it_is_wider():
    z = np.random.default_rng(13).normal(size=(4000, 3))
    usual, asked = domain.fit_domain(z, z), domain.fit_domain(z, z, share_out=0.025)
    assert usual.threshold == asked.threshold and (usual.lo == asked.lo).all()
    assert 0.001 < (~usual.familiar(z, z)).mean() < 0.025 and len(usual.range_lo) == 5


def test_the_margin_is_as_small_as_leaves_out_what_it_may():
    check = edge()
    y = np.column_stack([np.linspace(1.0, 2.0, 101), np.zeros(101), np.full(101, 9.0)])
    half = np.full((101, 3), 0.5)
    known = np.ones(101, bool)

    def margin(known, share, half=half, y=y):
        return domain.with_ranges(check, check.range_lo, check.range_hi, known, y, half, share).margin

    assert margin(known, 0.1) == pytest.approx(1.8)
    assert margin(np.arange(101) >= 5, 0.1) == pytest.approx(1.9), "what is strange anyhow is among them"
    assert margin(known, 0.1, y=y * [0.5, 1, 1]) == 0.0
    assert margin(known, 0.1, half=half / 100) == domain.LARGEST_MARGIN

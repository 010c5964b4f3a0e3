"""A validation tells bias, limits and coverage with intervals that know which strokes are of one lump."""

import numpy as np
import pandas as pd
import pytest
import statsmodels.formula.api as smf

from palpate.dataset import agreement as agree
from palpate.dataset.agreement import agreement, by_lump
from palpate.dataset.answers import OUTPUTS, JudgedAnswers
from palpate.learn.table import r_squared
from palpate.validation.report import write
from palpate.validation.result import _hardness, share
from palpate.validation.verdict import verdict


def told(lumps=30, strokes=3, bias=0.0, between=0.05, within=0.02, half=None, seed=1):
    """Answers whose errors of d are known: from lump to lump, and from stroke to stroke."""
    rng = np.random.default_rng(seed)
    group = np.repeat(np.arange(lumps), strokes)
    error = bias + between * rng.standard_normal(lumps)[group] + within * rng.standard_normal(len(group))
    truth = np.full((len(group), len(OUTPUTS)), np.nan)
    j = OUTPUTS.index("d_mm")
    truth[:, j] = rng.uniform(6, 18, lumps)[group]
    value = np.ones_like(truth)
    value[:, j] = truth[:, j] * np.exp(error)
    wide = 1.645 * np.hypot(between, within) if half is None else half
    yes = np.ones(len(group), bool)
    words = np.full(len(group), "unsure")
    return JudgedAnswers(
        value, value * np.exp(-wide), value * np.exp(wide), truth, yes, yes, ~yes, words, group, yes, 0.9
    )


def test_what_is_always_alike_gives_no_interval_and_no_warning(recwarn):
    """SciPy's word on degenerate data came out between the tables."""
    none = by_lump(np.repeat(np.arange(5), 2), lambda times: np.full(times.shape[:-1], np.nan))
    assert (none.low, none.high) == (None, None)
    assert not recwarn.list


def test_open_coverage_is_called_open():
    """ "May be right" was said of 53 % where 90 are meant."""
    said = verdict(agreement(told(8, half=0.06), "d_mm"), 0.9).text
    assert "Whether its intervals hold is not settled: they hold" in said and "where 90 % are meant" in said


def test_a_known_bias_and_known_limits_are_found():
    found = agreement(told(lumps=400, bias=0.1, seed=2), "d_mm")
    assert found.bias.low < 0.1 < found.bias.high
    wide = 1.96 * np.hypot(0.05, 0.02)
    assert found.limits[0].low < 0.1 - wide < found.limits[0].high
    assert found.limits[1].low < 0.1 + wide < found.limits[1].high
    assert found.coverage.value < 0.75, "the intervals know nothing of the bias"
    assert (found.sd_lump, found.sd_stroke) == pytest.approx((0.05, 0.02), rel=0.1)


def test_the_spread_is_that_of_a_mixed_model():
    said = told(lumps=40, between=0.08, within=0.03)
    found = agreement(said, "d_mm")
    table = pd.DataFrame({"e": found.errors, "lump": said.group})
    mixed = smf.mixedlm("e ~ 1", table, groups="lump").fit()
    assert found.sd_lump**2 == pytest.approx(float(mixed.cov_re.iloc[0, 0]), rel=0.05)
    assert found.sd_stroke**2 == pytest.approx(float(mixed.scale), rel=0.05)


def test_repeated_strokes_are_no_new_evidence():
    """Ten strokes over each of twelve lumps say as much as one, where strokes repeat exactly."""
    once, often = (agreement(told(12, n, within=0.0), "d_mm").bias for n in (1, 10))
    assert often.high - often.low == pytest.approx(once.high - once.low, rel=0.1)


def test_a_stroke_that_counts_twice_is_a_stroke_written_twice():
    """What is resampled all at once gives what repeated strokes give one by one."""
    said, j = told(9, 2, seed=4), OUTPUTS.index("d_mm")
    error, group = agree.errors_of("d_mm", said.value[:, j], said.truth[:, j]), said.group
    times = np.repeat(np.random.default_rng(5).integers(0, 4, (20, 9)), 2, axis=1).astype(float)
    every = [np.repeat(np.arange(18), row.astype(int)) for row in times]
    for statistic, alone in (
        (lambda t: agree._mean(error, t), lambda k: error[k].mean()),
        (lambda t: agree._median(error, t), lambda k: np.median(error[k])),
        (
            lambda t: agree._r2(said.truth[:, j], said.value[:, j], t),
            lambda k: r_squared(said.truth[k, j], said.value[k, j]),
        ),
        (lambda t: agree._spread(error, group, t)[0], lambda k: agree.spread(error[k], group[k])[0]),
        (lambda t: agree._spread(error, group, t)[1], lambda k: agree.spread(error[k], group[k])[1]),
    ):
        np.testing.assert_allclose(statistic(times), [alone(k) for k in every], rtol=1e-9)


def test_intervals_by_lump_hold_the_truth_as_often_as_they_say():
    held = []
    for seed in range(60):
        bias = agreement(told(25, 3, seed=seed), "d_mm").bias
        held.append(bias.low < 0 < bias.high)
    assert 0.85 <= np.mean(held) <= 1.0


def test_the_verdict_says_what_may_be_believed():
    good = verdict(agreement(told(300, between=0.02), "d_mm"), 0.9)
    assert good.believed is True and good.more_lumps == 0
    biased = verdict(agreement(told(30, bias=0.3), "d_mm"), 0.9)
    assert biased.believed is False and "reads too large: +3" in biased.text
    narrow = verdict(agreement(told(60, half=0.01), "d_mm"), 0.9)
    assert narrow.believed is False and "too narrow" in narrow.text
    open_ = verdict(agreement(told(12, between=0.1, seed=3), "d_mm"), 0.9)
    assert open_.believed is None and 0 < open_.more_lumps < 2000
    assert f"About {open_.more_lumps} more lumps would settle it." in open_.text


def test_so_many_more_lumps_do_settle_it():
    found = agreement(told(12), "d_mm")
    more = verdict(found, 0.9).more_lumps
    enough = agreement(told(12 + more, seed=2), "d_mm")
    assert enough.bias.high - enough.bias.low < 2 * 0.03 * 1.3


def test_hardness_is_counted_as_it_is_and_as_it_is_called():
    said = told(4, 1)
    truth = said.truth.copy()
    truth[:, OUTPUTS.index("E_inv23")] = [0.1, 0.1, 0.4, 0.4]
    from dataclasses import replace

    words = np.array(["hard", "soft", "unsure", "soft"])
    said = replace(said, truth=truth, hardness=words, hard=np.array([True, True, False, False]))
    table, wrong = _hardness(said)
    assert table.loc["hard"].tolist() == [1, 1, 0] and table.loc["soft"].tolist() == [0, 1, 1]
    assert wrong.value == pytest.approx(1 / 3)


def test_shares_have_wilson_s_interval():
    assert share(np.zeros(20, bool)).high == pytest.approx(0.161, abs=0.001)
    assert np.isnan(share(np.zeros(0, bool)).value)


def test_intervals_that_always_hold_are_not_sure_to():
    """Resampling twelve lumps that were all covered gave 100 to 100 %."""
    found = agreement(told(12, half=9.0), "d_mm")
    assert found.coverage.value == 1 and found.coverage.low == pytest.approx(0.757, abs=0.01)


def test_one_or_two_lumps_get_no_interval():
    group = np.array([0, 0, 1])
    assert by_lump(group, lambda times: times.sum(-1)).low is None
    assert agree.FEWEST == 3


def test_the_page_has_a_figure_and_a_verdict_for_each_output(tmp_path):
    from palpate.validation.result import Validation

    said = told()
    found = agreement(said, "d_mm")
    words = verdict(found, 0.9)
    table, wrong = _hardness(said)
    none = share(~said.lump)
    whole = Validation(said, {"d_mm": found}, {"d_mm": words}, table, none, none, none, wrong, ("row 2: so",))
    page = write(whole, tmp_path / "out", "a < b").read_text()
    assert words.text in page and "row 2: so" in page and "a &lt; b" in page
    assert (tmp_path / "out" / "d_mm.png").stat().st_size > 5000

"""A change between two visits is told from what strokes, and visits, differ by themselves."""

import numpy as np
import pandas as pd
import pytest

from palpate import models
from palpate.comparison.between import between_visits, components
from palpate.comparison.change import Between, compare
from palpate.dataset.columns import DataSetError
from palpate.dataset.table import DataSet


def visited(lumps, visits, strokes, of_visit, of_stroke, seed=1):
    rng = np.random.default_rng(seed)
    lump = np.repeat(np.arange(lumps), visits * strokes)
    visit = np.repeat(np.arange(lumps * visits), strokes)
    y = rng.uniform(2, 3, lumps)[lump] + of_visit * rng.standard_normal(lumps * visits)[visit]
    return y + of_stroke * rng.standard_normal(len(y)), lump, visit


def test_what_visits_differ_by_is_found():
    found = components(*visited(300, 3, 4, 0.05, 0.03))
    assert found.freedom == 600
    assert found.sd == pytest.approx(0.05, rel=0.06)


def test_scatter_of_strokes_is_not_taken_for_a_visit_s():
    assert components(*visited(300, 3, 4, 0.0, 0.03)).sd < 0.008


def test_one_visit_to_each_lump_tells_nothing():
    assert components(*visited(30, 1, 4, 0.05, 0.03)) is None


def test_intervals_hold_where_nothing_has_changed():
    """Visits that differ by 5 %: intervals that know it hold 0 in 95 of 100; those that do not, far less."""
    rng = np.random.default_rng(1)
    between = components(*visited(40, 2, 3, 0.05, 0.02))
    knowing, plain = [], []
    for _ in range(400):
        a, b = (
            (10 * np.exp(0.05 * rng.standard_normal() + 0.02 * rng.standard_normal(3))).tolist() for _ in "ab"
        )
        knowing.append(compare(a, b, between=between).beyond)
        plain.append(compare(a, b).beyond)
    assert 1 - np.mean(knowing) == pytest.approx(0.95, abs=0.04)
    assert 1 - np.mean(plain) < 0.7


def test_a_doubled_lump_is_beyond_all_of_it():
    found = compare([10, 10.1, 9.9], [20, 20.2, 19.8], between=Between(0.05, 20))
    assert found.beyond and "beyond what visits differ by" in found.text
    assert found.change_low < 10 < found.change_high


def test_a_data_set_without_repeated_visits_is_refused(tmp_path):
    table = pd.DataFrame({"row": [2, 3], "lump": ["A", "B"], "visit": ["1", "1"]})
    with pytest.raises(DataSetError, match="column visit: 2 lumps visited again"):
        between_visits(models.load(), DataSet(tmp_path / "set.csv", table))

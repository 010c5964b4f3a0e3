"""From what a posterior says of its unknowns to values with intervals, and several modes' as one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.inversion.valley import Spread
from palpate.inversion.values import mixed, values_of

FAT = {"E_fat_kPa": Spread(np.log(10.0), 0.1, 0.1)}


@given(st.floats(-3, 3), st.floats(0.01, 2), st.floats(0.01, 2), st.integers(1, 3))
def test_modes_that_say_the_same_say_it_together(middle, below, above, modes):
    said = Spread(middle, below, above)
    together = mixed([{"d_mm": said}] * modes, np.ones(modes))["d_mm"]
    assert together == pytest.approx(said, abs=0.02 * (below + above))


@given(st.floats(0.0, 0.45))
def test_what_two_modes_say_lies_between_them_nearer_to_the_likelier(share):
    likelier, other = Spread(0.0, 0.1, 0.1), Spread(1.0, 0.1, 0.1)
    said = mixed([{"d_mm": likelier}, {"d_mm": other}], np.array([1 - share, share]))["d_mm"]
    assert -0.01 <= said.middle < 0.5
    if share > 0.1:
        assert said.middle - said.below < 0.1 and said.middle + said.above > 0.9, "either may be right"


def test_a_lump_that_may_be_endlessly_hard_has_no_greatest_modulus():
    values = values_of(FAT | {"E_inv23": Spread(0.1, 0.2, 0.15)})
    assert values["E_inv23"].as_dict() == pytest.approx({"value": 0.1, "low": 0.0, "high": 0.25})
    assert values["E_ratio"].high is None and values["E_kPa"].high is None
    assert values["E_ratio"].low == pytest.approx(8.0)
    assert values["E_kPa"].value == pytest.approx(10 * 0.1**-1.5)


def test_lengths_are_told_by_their_logarithms_what_lies_between_lumps_is_not():
    values = values_of({"d_mm": Spread(np.log(12.0), 0.1, 0.2), "apart_mm": Spread(9.0, 1.0, 2.0)})
    assert values["d_mm"].as_dict() == pytest.approx(
        {"value": 12.0, "low": 12 * np.exp(-0.1), "high": 12 * np.exp(0.2)}
    )
    assert values["apart_mm"].as_dict() == pytest.approx({"value": 9.0, "low": 8.0, "high": 11.0})

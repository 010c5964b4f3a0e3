"""The study of fitted strokes judges them by what was under the probe."""

import pytest

from palpate.sim.probe.packed_frames import Truth
from palpate.sim.tissue import Case
from tests.studies.inverted import WORDS, truths_of


def test_the_fat_is_as_stiff_as_it_was_under_the_probe():
    """It was judged by the case that the stroke was drawn from, 2 % from the tissue that was felt."""
    case = Case(12.0, 0.5, 10.0, fat_kPa=8.0)
    truths = truths_of(Truth(case, 40.0, 0.0, stiffness=1.05))
    assert truths["E_fat_kPa"] == pytest.approx(8.4)
    assert all(truths[name] == getattr(case, name) for name in WORDS if name != "E_fat_kPa")

"""What is unlike the model is held by the intervals, or refused; both are counted."""

import numpy as np
import pytest

from tests.studies.inverted import WORDS
from tests.studies.unlike import WORLDS, flattened, judged


def told(held, fits=True):
    return {
        "problem": "",
        "fits": fits,
        "held": dict.fromkeys(WORDS, held),
        "apart": dict.fromkeys(WORDS, -0.02),
    }


def test_only_strokes_that_fit_are_held_against_the_truth():
    rows = [
        dict.fromkeys(WORLDS, told(True)),
        dict.fromkeys(WORLDS, told(False)),
        dict.fromkeys(WORLDS, told(False, fits=False)),
        {world: {"problem": "no equilibrium"} for world in WORLDS},
    ]
    (table,) = judged(rows)
    assert [row[0] for row in table.rows] == list(WORLDS)
    assert all(row[1:] == ["3", "33 %", *["50 %, 2.0"] * len(WORDS), "1 of 2"] for row in table.rows)


def test_a_flattened_lump_is_an_ellipse_as_large_and_its_surroundings_stay():
    turn = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    circle = 6.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    wide, high = np.ptp(flattened(circle, 6.0, 2.0), axis=0)
    assert wide / high == pytest.approx(1.15, rel=1e-3)
    assert wide * high == pytest.approx(144.0, rel=1e-3)
    assert (flattened(1.4 * circle, 6.0, 2.0) == 1.4 * circle).all()

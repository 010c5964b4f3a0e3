"""Which columns see a lump, and how it is spread across: the same from either side."""

from array import array

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from firmware_py import columns

COLS = columns.COLS


def rings(answer):
    found = array("i", bytes(12))
    columns.rings(array("i", answer), array("i", bytes(4 * COLS)), found, 0)
    return list(found)


def smoothed(answer):
    out = array("i", bytes(4 * COLS))
    columns.smooth(array("i", answer), 1, out)
    return list(out)


@given(st.lists(st.integers(-500, 9000), min_size=COLS, max_size=COLS))
def test_a_lump_seen_from_the_other_side_has_the_same_rings(answer):
    """The outermost column on one side was left out, and no test noticed."""
    assume(smoothed(answer).count(max(smoothed(answer))) == 1)
    assert rings(answer) == rings(answer[::-1])


def test_every_column_counts_for_its_ring():
    hill = 4000 * np.exp(-(((np.arange(COLS) - COLS // 2) / 3) ** 2))
    for best in (4, COLS // 2, COLS - 5):
        answer = np.roll(hill, best - COLS // 2).astype(int).tolist()
        plain = rings(answer)
        for column in range(COLS):
            more = list(answer)
            more[column] += 300
            off_mm = abs(column - best) * columns.geometry.PITCH_UM / 1000
            if 2 < off_mm <= 15:
                assert rings(more) != plain, (best, column)

"""The long campaign: two thousand strokes over the widest ranges, not one wrong (`make test-long`)."""

import numpy as np
import pytest

from sim.tissue import WIDEST, load_strokes, sobol_cases, sweep


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_two_thousand_random_strokes_all_converge_and_none_is_wrong(tmp_path):
    table = sweep(sobol_cases(2000, 5, WIDEST), out_dir=tmp_path)
    assert list(table.code[table.status != "ok"]) == []
    for stroke in load_strokes(tmp_path):
        assert np.abs(stroke.force_error).max() < 1e-6, stroke.code
        assert (stroke.images_kPa >= 0).all(), stroke.code
        assert (stroke.smallest_jacobian > 0).all(), stroke.code
        assert (np.abs(np.diff(stroke.displacement_mm)) < 1.5).all(), stroke.code

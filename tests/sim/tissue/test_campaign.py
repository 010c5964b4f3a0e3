"""The long campaigns: thousands of strokes over the widest ranges, not one wrong (`make test-long`)."""

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.sim.tissue import WIDEST, Case, Settings, load_strokes, simulate, sobol_cases, sweep
from palpate.sim.tissue.case import NONLINEAR_E_RATIO, NONLINEAR_STIFFENING


def shaped_cases(n: int, seed: int) -> list[Case]:
    """Over the same ranges: other faces and fillets, every third probe flat, every other lump nonlinear."""
    rng = np.random.default_rng(seed)
    cases = []
    for i, case in enumerate(sobol_cases(n, seed, WIDEST)):
        case = replace(
            case, face_half_mm=float(rng.uniform(6, 11)), fillet_per_mm2=float(rng.uniform(0.05, 0.2))
        )
        if i % 3 == 0:
            case = replace(case, probe_radius_mm=math.inf)
        if i % 2 == 0:
            case = replace(case, E_ratio=NONLINEAR_E_RATIO, lump_stiffening=NONLINEAR_STIFFENING)
        cases.append(case)
    return cases


@pytest.mark.long
@pytest.mark.timeout(7200)
@pytest.mark.parametrize(
    "cases", [sobol_cases(2000, 5, WIDEST), shaped_cases(400, 6)], ids=["round probes", "shapes, nonlinear"]
)
def test_random_strokes_all_converge_and_none_is_wrong(tmp_path, cases):
    table = sweep(cases, out_dir=tmp_path)
    assert list(table.code[table.status != "ok"]) == []
    strokes = load_strokes(tmp_path)
    for stroke in strokes:
        assert np.abs(stroke.force_error).max() < 1e-6, stroke.code
        assert (stroke.images_kPa >= 0).all(), stroke.code
        assert (stroke.smallest_jacobian > 0).all(), stroke.code
        assert (np.abs(np.diff(stroke.displacement_mm)) < 1.5).all(), stroke.code
    force_error = max(np.abs(stroke.force_error).max() for stroke in strokes)
    least = min(stroke.smallest_jacobian.min() for stroke in strokes)
    steps = np.concatenate([stroke.iterations for stroke in strokes])
    print(f"{len(strokes)} strokes, {len(steps)} positions, none failed")
    print(f"largest force error {force_error:.1e}, least det F {least:.2g}")
    print(f"iterations a position: {steps.mean():.1f}, {steps.max()} at worst")


def test_a_slide_that_turns_an_element_inside_out_is_done_again_in_smaller_steps():
    # One of 4096 strokes for the field model: 6 mm of fat over a hard lump, pressed hard, came to rest at
    # -2 mm in a balance with det F = -0.48. It was refused, but it could have been found.
    case = Case(d_mm=6.290027159266174, h=0.41057510040700435, E_ratio=117.21039608954418,
                F_rel=1.1394508878796863)  # fmt: skip
    coarse = simulate(case, Settings(far_start_mm=-44.0))
    assert coarse.smallest_jacobian.min() > 0.8
    assert np.abs(coarse.force_error).max() < 1e-6
    fine = simulate(case, Settings(hx_mm=1.0))
    assert coarse.displacement_mm[-1] == pytest.approx(fine.displacement_mm[-1], rel=0.005)

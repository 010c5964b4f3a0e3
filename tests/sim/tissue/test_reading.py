"""Rows and columns by the border of the contact are read as the tissue presses, not as the nodes lie."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.sim.tissue import Case, CaseError, Settings, simulate
from palpate.sim.tissue.reading import OWN_PLACES, Reading
from palpate.sim.tissue.solid.stroke import simulate_forces

STRAIGHT = Settings(shells=3)
TO_BORDER = replace(STRAIGHT, to_border=True)
PLACES = [-30.0, -27.7, -25.45, -23.2, -20.9, -18.65, -9.3, -3.3]
HALF = 10.5


def nodal(x, pressure):
    """What nodes x of quadratic elements bear of a pressure, over the integrals of their shape functions."""
    t = (np.arange(20000) + 0.5) / 20000
    shapes = (1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)
    force, area = np.zeros_like(x), np.zeros_like(x)
    for k in range(0, len(x) - 2, 2):
        length = x[k + 2] - x[k]
        for j, N in enumerate(shapes):
            force[k + j] += length * (N * pressure(x[k] + length * t)).mean()
            area[k + j] += length * N.mean()
    touches = np.abs(x) <= HALF
    return np.where(touches, force / area, 0.0)


@given(shift=st.floats(0.0, 2.0), width=st.floats(1.0, 2.2))
def test_a_root_of_the_distance_is_read_wherever_the_nodes_lie(shift, width):
    def pressure(s):
        return 3 * np.sqrt(np.maximum(1 - (s / HALF) ** 2, 0.0))

    x = -26.0 + shift + width / 2 * np.arange(121)
    p = nodal(x, pressure)
    fine = OWN_PLACES[:, :1] + (np.arange(3000) + 0.5) / 3000 * 1.5
    exactly = pressure(fine).mean(1)
    off, straight = (np.abs(Reading(x, how)(x, p) - exactly).max() for how in (True, False))
    assert off < 0.05
    assert off < 0.7 * straight


@pytest.mark.parametrize("code", ["d08h08e20f05_G4_g15", "d12h04e05f09_G4_g15"])
def test_rows_by_the_border_hardly_depend_on_the_columns(code):
    case = Case.from_code(code)
    fine = simulate(case, replace(TO_BORDER, hx_mm=0.25), positions_mm=PLACES).images_kPa

    def off(settings):
        found = simulate(case, settings, positions_mm=PLACES).images_kPa
        return np.sqrt(np.square(found - fine).mean())

    assert off(TO_BORDER) < 0.75 * off(STRAIGHT)
    assert off(replace(TO_BORDER, hx_mm=1.0)) < 0.5 * off(replace(STRAIGHT, hx_mm=1.0))


def test_a_face_over_a_ball_reads_the_same_by_columns_twice_as_wide():
    """Read straight from node to node, the outermost columns differed by twice as much."""
    case = Case.from_code("d08h08e20f05_ball")

    def read(hx_mm):
        (found,) = simulate_forces(case, [case.F_rel], Settings(hx_mm=hx_mm), [-28.3])
        return found.images_kPa[0] / found.images_kPa.mean()

    off = np.abs(read(3.0) - read(1.5))
    assert np.sqrt((off**2).mean()) < 0.012
    assert off[:, [0, -1]].mean() < 0.009


def test_whether_rows_are_read_up_to_the_border_is_yes_or_no():
    with pytest.raises(CaseError, match="to_border must be True or False, not 1"):
        Settings(to_border=1)


def test_no_row_jumps_where_a_node_lets_go():
    """With nothing but the last node's own ratio a row jumped by 20 Pa, and searches stalled."""
    case, places = Case.from_code("d08h08e20f05_G4_g15"), -26.0 + 0.02 * np.arange(60)
    rows = simulate(case, replace(TO_BORDER, hx_mm=1.0, tolerance=1e-7), positions_mm=places).images_kPa
    assert np.abs(np.diff(rows, axis=0)).max() < 7e-3

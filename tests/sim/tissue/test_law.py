"""The laws of stiffening: what their papers say of a block in pure shear, and that none jumps."""

import os
from importlib import util
from pathlib import Path

import numpy as np
import pytest

from palpate.sim.tissue import kernels, law
from palpate.sim.tissue.case import LAWS, Case
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.law import EXPONENTIAL, OGDEN, phi
from palpate.sim.tissue.records import SCHEMA, record_of, stroke_of
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.stroke import simulate

STRETCH = np.array([1.02, 1.1, 1.3])


@pytest.mark.parametrize("b", [1.0, 6.0])
def test_ogdens_law_in_the_plane_is_the_papers_in_principal_stretches(b):
    """Ogden 1972: W = 2 mu / a^2 (l1^a + l2^a + l3^a - 3), here with l2 = 1 / l1 and l3 = 1."""
    a = 2 + b
    energy, first, _ = phi(OGDEN, (STRETCH - 1 / STRETCH) ** 2, np.full(3, b))
    np.testing.assert_allclose(energy / 2, 2 / a**2 * (STRETCH**a + STRETCH**-a - 2), rtol=1e-12)
    # the principal stresses' difference, l dW/dl, which a shear of the block measures
    stress = 2 / a * (STRETCH**a - STRETCH**-a)
    np.testing.assert_allclose(first * (STRETCH**2 - STRETCH**-2), stress, rtol=1e-12)


@pytest.mark.parametrize("law", range(len(LAWS)))
@pytest.mark.parametrize("b", [0.0, 1e-6, 3.0, 900.0])
def test_every_law_begins_linear_and_goes_on_smoothly_beyond_its_cap(law, b):
    I = np.concatenate([[0.0], np.geomspace(1e-12, 30.0, 4001)])
    energy, first, second = phi(law, I, np.full(len(I), b))
    assert energy[0] == 0.0 and first[0] == 1.0
    assert np.isfinite(energy).all() and (np.diff(first) >= -1e-12).all() and (second >= -1e-12).all()
    step = np.diff(I)
    np.testing.assert_allclose(np.diff(energy), step * (first[1:] + first[:-1]) / 2, rtol=2e-3)


def test_both_laws_are_one_where_the_strain_is_small():
    for b in (3.0, 30.0):
        ogden = (2 + b) ** 2 / 24 - 4 / 24  # phi'' at rest of the exponential law that is as curved
        I = np.array([1e-5])
        assert phi(OGDEN, I, np.array([b]))[1] == pytest.approx(
            phi(EXPONENTIAL, I, np.array([ogden]))[1], rel=1e-6
        )


def test_a_case_says_its_law_and_keeps_it():
    case = Case.from_code("d10h08e10f10_ogden_sf4")
    assert case.law == "ogden" and case.code == "d10h08e10f10_ogden_sf4"
    assert "law" not in Case.from_code("d10h08e10f10_sf4").to_dict(), (
        "strokes that are stored keep their keys"
    )
    stroke = simulate(case, Settings(hx_mm=4.0), [-28.0, 0.0])
    row = dict.fromkeys(SCHEMA.names) | record_of("k", case, stroke)
    assert stroke_of(row).case == case
    assert (
        stroke.displacement_mm[0]
        < simulate(Case(10, 0.8, 10), Settings(hx_mm=4.0), [-28.0]).displacement_mm[0]
    )
    for wrong in ({"law": "hooke"}, {"law": "ogden", "shape": "ball"}):
        with pytest.raises(CaseError, match="law"):
            Case(10, 0.8, 10, **wrong)


def test_kernels_are_compiled_again_when_the_law_that_they_call_has_changed(tmp_path):
    """A law tried as a stranger was the exponential, silently, out of the kept machine code."""
    path = tmp_path / "calls.py"
    path.write_text("from numba import njit\n\n@njit(cache=True)\ndef twice(x):\n    return 2 * x\n")
    spec = util.spec_from_file_location("calls", path)
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.twice(1.0) == 2.0
    (index,) = Path(module.twice.stats.cache_path).glob("calls.twice-*.nbi")
    kernels.renew(path, module.twice)
    assert index.exists(), "the code is younger"
    long_ago = Path(law.__file__).stat().st_mtime - 1
    os.utime(index, (long_ago, long_ago))
    kernels.renew(law.__file__, module.twice)
    assert not index.exists()

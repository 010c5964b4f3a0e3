"""Where the lump lies is told by the stroke itself, or not at all."""

import numpy as np
import pytest

from palpate.inversion.felt import felt_stroke
from palpate.inversion.mirror import mirrored_about
from palpate.inversion.strokes import invert_stroke
from palpate.sim.probe.noise import LEVELS
from palpate.sim.tissue import Case
from tests.host.inversion.test_inversion import frames
from tests.host.inversion.world import felt_of


def over_a_lump(at_mm, height, seed=0, end_mm=30.0):
    """A stroke whose rows rise by a share of themselves over a lump; noise of typical row means."""
    rng = np.random.default_rng(seed)
    place = np.concatenate([np.full(10, -30.0), np.linspace(-30, end_mm, 60)])
    rows = np.linspace(-11, 11, 16)
    apart = place[:, None] + rows - at_mm
    force = 1 + 0.03 * np.cumsum(rng.normal(0, 0.3, len(place)))[:, None]
    pressure = 5.0 * np.cos(rows / 9) * force * (1 + height * np.exp(-((apart / 7) ** 2)))
    pressure = np.repeat(pressure[:, :, None], 26, axis=2) + rng.normal(0, 0.02, (70, 16, 1))
    depth = np.linspace(0.5, 2.0, 70)
    return felt_stroke(**frames(70, pressure_kPa=pressure, place_mm=place, displacement_mm=depth))


@pytest.mark.parametrize("at_mm", [-14.0, -3.4, 8.2])
@pytest.mark.parametrize("height", [0.05, 1.0])
def test_a_stroke_is_a_mirror_image_about_its_lump(at_mm, height):
    assert mirrored_about(over_a_lump(at_mm, height)) == pytest.approx(at_mm, abs=1.0)


@pytest.mark.parametrize("seed", range(10))
def test_over_plain_tissue_no_place_is_told(seed):
    assert mirrored_about(over_a_lump(0.0, 0.0, seed)) is None


def test_nor_is_one_in_the_shortest_stroke():
    """None is far enough from the best to be compared with it."""
    assert mirrored_about(over_a_lump(-18.0, 1.0, end_mm=-4.5)) is None


@pytest.mark.long
def test_a_soft_lump_that_the_regression_takes_for_another_part_of_the_stroke_is_found():
    """Its place was believed, 10 mm off: the coarse mesh hid that, and on the fine one nothing led back."""
    case = Case.from_code(
        "d6.349h0.492e2.707f1.812733539094213_R39.43_g15.18_G4.691_Y29.284871390859657_sg2.151_t4.145"
    )
    felt, start, _, _ = felt_of(case, 12048)
    assert abs(mirrored_about(felt) - start.lump_mm) > 8
    found = invert_stroke(felt, start, LEVELS["typical"], "anywhere")
    assert found.fits and found.centre_mm == pytest.approx(1.0, abs=0.5)
    assert found.values["d_mm"].value == pytest.approx(case.d_mm, rel=0.1)

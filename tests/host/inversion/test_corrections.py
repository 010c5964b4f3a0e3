"""What the solver says otherwise than the emulator, at the frames it was asked about and between them."""

import numpy as np
import pytest

from palpate.inversion.corrections import Corrections

PLACES_MM = np.linspace(-30.0, 0.0, 61)
LN_F = np.full(61, 0.7)
THETA = np.zeros(3)


def wrong_of(size, along_mm):
    """What an emulator gets wrong of frames (61, 17), as smooth along the stroke as that."""
    alike = np.exp(-(((PLACES_MM[:, None] - PLACES_MM) / along_mm) ** 2) / 2) + 1e-9 * np.eye(61)
    return size * np.linalg.cholesky(alike) @ np.random.default_rng(3).standard_normal((61, 17))


@pytest.mark.parametrize("along_mm", [1.5, 3.0])
@pytest.mark.parametrize("size", [1e-3, 2e-2])
def test_it_knows_how_far_off_the_frames_are_that_the_solver_was_not_asked_about(size, along_mm):
    """Over a shallow hard lump they were off by 1 to 2 %, and intervals were told as if by .1 %."""
    wrong, asked = wrong_of(size, along_mm), np.arange(0, 61, 8)
    corrections = Corrections(np.ones(3), 17)
    smooth = corrections.add(THETA, PLACES_MM[asked], LN_F[asked], wrong[asked], None)
    left = corrections(THETA, PLACES_MM, LN_F)[0][0] - wrong
    off = np.sqrt((left**2).mean())
    assert 0.7 * off < smooth.off(PLACES_MM, LN_F) < 2.2 * off

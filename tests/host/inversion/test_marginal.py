"""Intervals know that a posterior is curved: how an unknown falls off on either side of the mode."""

import numpy as np
import pytest

from palpate.inversion.classes import Class, Unknown
from palpate.inversion.found import Found
from palpate.inversion.joint import Together
from palpate.inversion.marginal import with_sides
from palpate.inversion.posterior import Misfit
from palpate.inversion.search import search
from palpate.inversion.widening import NORMAL
from tests.host.inversion.toys import Nothing

NAMES = "ln d", "ln depth", "ln_E"


class Curved:
    """Three numbers: ln depth is known by ln d and, where it bends, by its square; E is tied to neither."""

    within = Together.within
    at = {"tissue": slice(0, 2), "ln_E": slice(2, 3)}  # noqa: RUF012
    measured = 3

    def __init__(self, bend):
        self.bend = bend
        self.sd = np.array([1.0, 3.0, 1.0])
        unknowns = tuple(Unknown(name, 0.0, 1.0, -9.0, 9.0, 1.0) for name in NAMES[:2])
        self.of = Class("curved", unknowns, lambda theta: None, ())

    def places(self, z):
        return z[:1]

    def forces(self, z):
        return z[:1]

    def misfit(self, z, _):
        d, depth, E = z
        return Misfit(np.array([[(depth - d - self.bend * d**2) / 0.2, E / 0.5]]), z / self.sd)

    def jacobian(self, z, _, __):
        steep = np.array([[-(1 + 2 * self.bend * z[0]) / 0.2, 1 / 0.2, 0.0], [0.0, 0.0, 2.0]])
        return steep, np.diag(1 / self.sd)


def found_over(bend, far=0.0):
    posterior, forward = Curved(bend), Nothing(far)
    return Found(posterior, forward, search(posterior, forward, np.zeros(3), 30, enough=1e-9), [])


def test_where_all_is_linear_both_sides_are_laplace_s():
    mode = with_sides(found_over(0.0)).mode
    for at, name in enumerate(NAMES):
        assert mode.sides[name] == pytest.approx([np.sqrt(mode.covariance[at, at])] * 2, rel=0.02)


def test_over_a_bent_valley_they_are_those_of_the_whole_posterior():
    found = with_sides(found_over(0.2))
    axes = [np.linspace(-9, 9, 721)] * 2
    z = np.stack([*np.meshgrid(*axes, indexing="ij"), np.zeros((721, 721))], -1)
    d, depth = z[..., 0], z[..., 1]
    density = np.exp(-0.5 * (((depth - d - 0.2 * d**2) / 0.2) ** 2 + d**2 + (depth / 3) ** 2))
    for at, name in enumerate(NAMES[:2]):
        below = np.cumsum(density.sum(1 - at))
        low, high = np.interp([0.05, 0.95], below / below[-1], axes[at])
        mode = found.mode.z[at]
        assert NORMAL * np.array(found.mode.sides[name]) == pytest.approx([mode - low, high - mode], rel=0.15)
    below, above = found.mode.sides["ln depth"]
    assert above > 1.3 * below


def test_where_nothing_was_computed_a_worse_fit_says_less():
    """Small deep lumps were held in 70 %: away from the guesses that were computed an emulator fits worse."""
    near, far = (with_sides(found_over(0.0, far)).mode.sides for far in (0.0, 0.5))
    for name in NAMES[:2]:
        assert min(far[name]) > 1.2 * max(near[name])
    assert far["ln_E"] == pytest.approx(near["ln_E"], rel=0.01)

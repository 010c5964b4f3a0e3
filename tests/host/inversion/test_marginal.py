"""Intervals know that a posterior is curved: how an unknown falls off on either side of the mode."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.inversion.classes import Class, Unknown
from palpate.inversion.found import Found
from palpate.inversion.joint import Together
from palpate.inversion.marginal import valley_along, with_sides
from palpate.inversion.posterior import Misfit
from palpate.inversion.search import search
from palpate.inversion.valley import sum_of
from palpate.inversion.widening import NORMAL
from tests.host.inversion.toys import Nothing

NAMES = "ln d", "ln depth", "ln_E"


class Curved:
    """Three numbers: ln depth is known by ln d and, where it bends, by its square; E is tied to neither."""

    within = Together.within
    at = {"tissue": slice(0, 2), "ln_E": slice(2, 3)}  # noqa: RUF012
    measured = 3

    def __init__(self, bend, least):
        self.bend = bend
        self.sd = np.array([1.0, 3.0, 1.0])
        unknowns = tuple(Unknown(name, 0.0, 1.0, least, 9.0, 1.0) for name in NAMES[:2])
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


def found_over(bend, far=0.0, least=-9.0):
    posterior, forward = Curved(bend, least), Nothing(far)
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


def test_along_a_bent_valley_every_sum_has_the_middle_and_the_ends_of_the_whole_posterior():
    found = found_over(0.2)
    valley = valley_along(found.posterior, found.forward, found.mode, 0)
    some = np.random.default_rng(1)
    d = np.linspace(-9, 9, 3601)
    steep = 0.2**-2 + 3.0**-2  # given d all else is normal
    depth_at, least = (d + 0.2 * d**2) * 0.2**-2 / steep, -0.5 * d**2
    logs = least - 0.5 * (d + 0.2 * d**2) ** 2 / (0.2**2 + 3.0**2)
    drawn = some.choice(len(d), 400_000, p=np.exp(logs) / np.exp(logs).sum())
    depth = depth_at[drawn] + some.standard_normal(len(drawn)) / np.sqrt(steep)
    for weights in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.5, 1.0, 0.0], [1.0, 0.5, 0.0]):
        low, middle, high = np.quantile(np.column_stack([d[drawn], depth]) @ weights[:2], [0.05, 0.5, 0.95])
        told = valley.spread(sum_of(np.array(weights)))
        assert told.middle == pytest.approx(middle, abs=0.1)
        assert NORMAL * np.array(told[1:]) == pytest.approx([middle - low, high - middle], rel=0.1)


def test_what_follows_from_several_unknowns_is_worked_out_slice_by_slice():
    """The fat's thickness, of depth and height, had errors of twice what was told: linear about the mode."""
    found = found_over(0.0)
    valley = valley_along(found.posterior, found.forward, found.mode, 0)

    def thickness(z):
        half, depth = np.exp(z[0]) / 2, np.exp(z[1])
        return np.log(half + depth), np.array([half, depth, 0.0]) / (half + depth)

    drawn = np.random.default_rng(1).multivariate_normal(np.zeros(3), found.mode.covariance, 400_000)
    drawn[:, 1] *= -1  # a deeper lump is a smaller one
    T = np.diag([1.0, -1.0, 1.0])
    low, middle, high = np.quantile(np.log(np.exp(drawn[:, 0]) / 2 + np.exp(drawn[:, 1])), [0.05, 0.5, 0.95])
    told = valley.turned(T).spread(thickness)
    assert told.middle == pytest.approx(middle, abs=0.03)
    assert NORMAL * np.array(told[1:]) == pytest.approx([middle - low, high - middle], abs=0.05)


def test_where_the_mode_is_at_the_end_of_what_may_be_the_middle_is_told():
    """Over balls modes lay at the hardest that is known, with as likely softer ones all to one side."""
    found = found_over(0.0, least=0.0)
    told = valley_along(found.posterior, found.forward, found.mode, 0).spread(
        sum_of(np.array([1.0, 0.0, 0.0]))
    )
    assert found.mode.z[0] == pytest.approx(0.0, abs=1e-6)
    sd = np.sqrt(found.mode.covariance[0, 0])
    assert told.middle == pytest.approx(0.674 * sd, rel=0.05)
    assert told.middle - NORMAL * told.below == pytest.approx(0.063 * sd, abs=0.05)
    assert told.middle + NORMAL * told.above == pytest.approx(1.960 * sd, rel=0.1)


def test_a_mode_rounded_to_beyond_the_end_of_its_range_is_cut_once_there():
    """One phantom's mode lay a last bit beyond its range: two slices at one value ended `refine`."""
    found = found_over(0.0, least=0.0)
    beyond = replace(found.mode, z=found.mode.z - [1e-16, 0.0, 0.0])
    valley = valley_along(found.posterior, found.forward, beyond, 0)
    assert np.diff(valley.at).min() > 1e-3
    inside = valley_along(found.posterior, found.forward, found.mode, 0)
    first = sum_of(np.array([1.0, 0.0, 0.0]))
    assert valley.spread(first)[:] == pytest.approx(inside.spread(first)[:])


def test_a_valley_that_is_straight_is_laplace_s_and_turns_with_its_unknowns():
    found = found_over(0.0)
    valley = valley_along(found.posterior, found.forward, found.mode, 0)
    T = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, -1.0]])
    for weights in np.eye(2):
        told, sd = (
            valley.turned(T).spread(sum_of(weights)),
            np.sqrt(weights @ T @ found.mode.covariance @ T.T @ weights),
        )
        assert told.middle == pytest.approx(0.0, abs=0.02) and told[1:] == pytest.approx([sd, sd], rel=0.05)
    told = found.mode.own(T).spread(sum_of(np.array([1.0, 0.0])))
    assert told.middle == pytest.approx(0.0, abs=1e-6) and told.below == told.above

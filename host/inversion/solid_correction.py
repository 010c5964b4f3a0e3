"""What the solver says otherwise than the emulator of solid lumps, at one guess and, to first order, near it.

So the emulator, set right, has the solver's value and slope there, and a search that ends there has ended at
a minimum of the solver's misfit: Alexandrov & Lewis, An overview of first-order model management for
engineering optimization, Optimization and Engineering 2 (2001). In fat of 10 kPa. Units: mm, kPa, N/m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.linalg import block_diag

from palpate.inversion.classes import FAT_KPA, STEP, differences
from palpate.inversion.forward import Slopes
from palpate.inversion.solid_emulator import binned_cells, emulated, inputs, positions
from palpate.learn.emulator import ON_LINE_MM, StrokeEmulator
from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.any_tissue import FORCE_PARTS
from palpate.sim.tissue.solid.derivatives import SolidDerivatives, differentiable, strokes_with_derivatives
from palpate.sim.tissue.solid.result import SolidStroke
from palpate.sim.tissue.solid.stroke import RAMP, simulate_forces

Floats = NDArray[np.float64]

NODES = np.log(FORCE_PARTS)
"""Logarithms of a stroke's three forces over the middle one, ..."""
RAMP_NODES = np.log(RAMP) + NODES[0]
"""... and of a ramp's."""
_MIDDLE = len(FORCE_PARTS) // 2
_MESH = Settings(all_rows=True)
"""With a row more or less what a lump feels like jumps against its neighbours."""

_FIELDS = (
    "d_mm", "h", "half_across_mm", "half_down_mm", "gland_ratio", "gland_mm", "probe_radius_mm", "E_ratio",
    "fat_stiffening", "gland_stiffening", "offset_mm",
)  # fmt: skip
"""Those that `_numbered` changes."""
_FAR = np.array([0.25, 0.2, 0.3, 0.3, 0.4, 0.4, 0.03, 0.12, 0.8, 0.8, 1.5])
"""Of `_numbers`: farther away what the solver said changes no more."""
_LEAST = np.array([-np.inf] * 8 + [STEP, STEP, -np.inf])
"""Of `_numbers`: tissue cannot stiffen by less than nothing, a step away either."""


def _numbers(case: Case) -> Floats:
    """What may differ between lumps under one force; the offset is last."""
    along, across, down = case.half_axes_mm
    lengths = [along, case.depth_mm, across, down, case.gland_ratio, case.gland_mm, case.probe_radius_mm]
    return np.array(
        [*np.log(lengths), case.E_inv23, case.fat_stiffening, case.gland_stiffening, case.offset_mm]
    )


def _numbered(case: Case, numbers: Floats) -> Case:
    """The ellipsoid of other numbers."""
    along, depth, across, down, ratio, gland, radius = np.exp(numbers[:7]).tolist()
    s, fat_b, gland_b, offset = numbers[7:].tolist()
    return replace(
        case, d_mm=2 * along, h=depth / (2 * along), half_across_mm=across, half_down_mm=down,
        gland_ratio=ratio, gland_mm=gland, probe_radius_mm=radius, E_ratio=s**-1.5, fat_stiffening=fat_b,
        gland_stiffening=gland_b, offset_mm=offset,
    )  # fmt: skip


@dataclass(frozen=True)
class Correction:
    """What the solver says otherwise than the emulator, at one guess.

    Attributes
    ----------
    case : Case
        At the middle of the three forces.
    image : ndarray (3, positions, bins); (3, 1, bins) without a lump
        Over the force, at `FORCE_PARTS` of the middle one.
    depth : ndarray (3, positions) or (3, 1)
        Of the displacement, over itself.
    ramp_image, ramp_depth : ndarray (5, bins), (5,)
        At the first position, at rising forces from the ramp's on.
    by : Slopes, optional
        Of image (positions + ramp, bins, k) and depth (positions + ramp, k) by `_numbers`, at the middle
        force, then at the ramp's; unknown without a lump.
    """

    case: Case
    image: Floats
    depth: Floats
    ramp_image: Floats
    ramp_depth: Floats
    by: Slopes | None = None

    @property
    def middle(self) -> float:
        """ln of the middle force over the fat's modulus."""
        return float(np.log(self.case.F_N_per_m / self.case.fat_kPa))

    def at(self, over_middle: Floats, press: int) -> list[Floats]:
        """As `at_levels`: images over the force and displacements over themselves."""
        nodes = np.append(RAMP_NODES, NODES)
        pairs = ((self.ramp_image, self.image), (self.ramp_depth, self.depth))
        return [one for pair in pairs for one in at_levels(over_middle[:press], nodes, *pair)]

    def sloping(self, over_middle: Floats, press: int) -> list[Floats]:
        """As `at`, by each of the numbers, (..., k); nothing without a lump."""
        if self.by is None:
            return []
        nodes, places = np.append(RAMP_NODES, NODES), self.image.shape[1]
        out: list[Floats] = []
        for of in (self.by.images, self.by.depth):
            pressed = np.concatenate([of[places:], np.repeat(of[:1], len(NODES), axis=0)])
            stroke = np.repeat(of[None, :places], len(NODES), axis=0)
            out += at_levels(over_middle[:press], nodes, pressed, stroke)
        return out

    def away(self, case: Case) -> Floats:
        """How far another case is, (k,), in numbers; no farther than `_FAR`."""
        return np.clip(_numbers(case) - _numbers(self.case), -_FAR, _FAR)


def correction_at(case: Case, emulator: StrokeEmulator) -> Correction:
    """Compute the strokes of one guess, at three forces about its own; a press alone where there is no lump.

    Raises
    ------
    CaseError, StrokeError
        There is no such lump, or no equilibrium.
    """
    if abs(case.offset_mm) < ON_LINE_MM:  # that costs the solver a quarter
        case = replace(case, offset_mm=0.0)
    places = positions(emulator, case.has_lump)
    found, derivatives = _computed(case, places)
    unit = np.array([one.case.F_N_per_m for one in found])
    x = np.array([inputs(one.case) for one in found])
    images, depths = emulator.pressed(x)
    if case.has_lump:
        images, depths = emulator.stroked(x, images, depths)
    else:
        images, depths = images[:, None], depths[:, None]
    computed = np.array([one.images_kPa for one in found])
    image = binned_cells((computed - images).reshape(len(found), len(places), -1)) / unit[:, None, None]
    depth = np.array([one.displacement_mm for one in found]) / depths - 1
    low = np.repeat(x[:1], len(RAMP), axis=0)
    low[:, -1] += np.log(RAMP)
    low_images, low_depths = emulator.pressed(low)
    ramp = binned_cells((found[0].ramp_images_kPa - low_images).reshape(len(RAMP), -1))
    ramp = ramp / (unit[0] * np.array(RAMP))[:, None]
    low_depth = found[0].ramp_displacement_mm / low_depths - 1
    by = None
    if derivatives is not None:
        x, over = np.vstack([x[_MIDDLE], low]), np.append(depth[_MIDDLE, _differentiated(places)], low_depth)
        by = _less_emulated(emulator, case, derivatives, x, 1 + over, places)
    return Correction(
        case, image, depth,
        np.concatenate([ramp, image[:, 0]]), np.concatenate([low_depth, depth[:, 0]]), by,
    )  # fmt: skip


def _computed(case: Case, places: Floats) -> tuple[list[SolidStroke], SolidDerivatives | None]:
    """Strokes at three forces and, over a lump, the middle one's derivatives."""
    forces = [case.F_rel * part for part in FORCE_PARTS]
    if not case.has_lump:
        return simulate_forces(case, forces, _MESH, places.tolist(), ramp=True), None
    by = [name for name in differentiable(case) if name in _FIELDS]
    return strokes_with_derivatives(
        case, forces, _MESH, places.tolist(), by, True, _MIDDLE, _differentiated(places)
    )


def _differentiated(places: Floats) -> list[int]:
    """Of the places, those where slopes are taken: over the lump, every second before it, the first."""
    return sorted({0, *range(len(places) - 1, 0, -2)})


def _less_emulated(
    emulator: StrokeEmulator, case: Case, computed: SolidDerivatives, x: Floats, over: Floats, places: Floats
) -> Slopes:
    """Slopes of what the solver says otherwise; from place to place they are straight.

    Parameters
    ----------
    x : ndarray (1 + ramp, 14)
        The emulator's inputs at the middle force and the ramp's.
    over : ndarray (differentiated + ramp,)
        Computed displacements over emulated ones.
    """
    numbers = np.maximum(_numbers(case), _LEAST)
    fields = computed.by[:-2]
    of_fields = differences(
        lambda n: [getattr(_numbered(case, n), name) for name in fields], numbers, len(numbers)
    )
    of_inputs = differences(lambda n: inputs(_numbered(case, n)), numbers, len(numbers))
    if "offset_mm" not in fields:
        of_inputs[:, -1] = 0.0
    stroke, ramp = emulated(emulator, x[:1], True), emulated(emulator, x[1:], False)
    at = _differentiated(places)
    _, of_image, depth, of_depth = (np.concatenate([a[0, at], b[:, 0]]) for a, b in zip(stroke, ramp))
    k = len(fields)
    images = np.concatenate([computed.images, computed.ramp_images])[..., :k]
    depths = np.concatenate([computed.displacement, computed.ramp_displacement])[:, :k]
    force = FAT_KPA * np.exp(np.append(np.full(len(at), x[0, -1]), x[1:, -1]))
    images = binned_cells(images.reshape(len(images), -1, k), -2) @ of_fields
    images -= binned_cells(of_image, -2) @ of_inputs
    longer = (depths @ of_fields - over[:, None] * (of_depth @ of_inputs)) / depth[:, None]
    between = make_interp_spline(places[at], np.eye(len(at)), k=1)(places)
    shares = block_diag(between, np.eye(len(x) - 1))
    return Slopes(np.tensordot(shares, images / force[:, None, None], 1), shares @ longer)


def at_levels(at: Floats, nodes: Floats, press: Floats, stroke: Floats) -> tuple[Floats, Floats]:
    """Tables at a press' forces, logarithms (p,), linear between nodes (r,), and at a stroke's.

    Parameters
    ----------
    press : ndarray (r, ...)
        At the nodes, wherever it stands.
    stroke : ndarray (3, positions, ...)

    Returns
    -------
    tables : ndarray (p + 3, positions, ...)
    slopes : ndarray (p, ...)
        Of the press', by the logarithm of its force.
    """
    k = np.clip(np.searchsorted(nodes, at) - 1, 0, len(nodes) - 2)
    width = np.diff(nodes)[k]
    share = np.clip((at - nodes[k]) / width, 0.0, 1.0)
    within = (at >= nodes[0]) & (at <= nodes[-1])
    eye = np.eye(len(nodes))
    shares = (1 - share)[:, None] * eye[k] + share[:, None] * eye[k + 1]
    steep = (within / width)[:, None] * (eye[k + 1] - eye[k])
    own = np.tensordot(shares, press, 1)
    tables = np.concatenate([np.repeat(own[:, None], stroke.shape[1], axis=1), stroke])
    return tables, np.tensordot(steep, press, 1)

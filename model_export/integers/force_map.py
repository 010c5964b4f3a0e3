"""The force map: learned from pairs of strokes at two forces, packed for firmware_py.forcemap.

Every frame of a stroke is moved to the stroke's mean force by the derivatives dp/d ln F and
d ln D/d ln F. Both are linear in the relative image p / mean(p) and quadratic in ln F and ln D. Probe
and layers are symmetric, so the map is fitted to the even and odd halves of the image apart; q = p / mean(p).
A map of the pressure alone does without ln D, and leaves the displacement as it is.

Units: kPa, mm; ln F is the logarithm of the image's sum of pressures, a row each, in kPa.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import forcemap, geometry
from palpate.errors import UsageError

Floats = NDArray[np.float64]

Q5_PER_COUNT = 32
DEPTH_UNITS_PER_MM = 16000
ROWS, HALF = geometry.ROWS, geometry.HALF_ROWS
FINEST, COARSEST = 14, 12  # Q formats of the coefficients
_LARGEST = 32767 / 2.0**COARSEST
_OF_THE_DEPTH = (2, 4, 5)  # inputs of the even half
_NOISE_KPA = 0.012
"""Given to the inputs, so that the map does not rely on what a sensor cannot show: white noise of .25 % of 25
kPa over 26 columns."""
_RIDGE = 1e-4
"""Relative."""


@dataclass(frozen=True)
class ForceMap:
    """A fitted force map.

    Attributes
    ----------
    even : ndarray (14, 9) for 16 rows
        Inputs 1, lnF, lnD, lnF^2, lnF lnD, lnD^2 (less their centres) and (q_i + q_15-i)/2 - 1, i = 0..7;
        outputs the even half of d q_i/d ln F, i = 0..7, and d ln D/d ln F.
    odd : ndarray (8, 8)
        From (q_i - q_15-i)/2 to the odd half.
    ln_F : float
        Centre of ln(sum of the image / kPa).
    ln_D : float or None
        Centre of ln(D / mm); None for a map of the pressure alone.
    rms : float
        Residual of the fit, of the image's mean, over all sensors.
    """

    even: Floats
    odd: Floats
    ln_F: float
    ln_D: float | None
    rms: float = float("nan")

    def as_dict(self) -> dict[str, Any]:
        """What travels in model.json."""
        out = asdict(self)
        return out | {"version": forcemap.VERSION, "even": self.even.tolist(), "odd": self.odd.tolist()}

    @classmethod
    def from_dict(cls, d: dict[str, Any]) -> ForceMap:
        """Read back what `as_dict` wrote; ValueError if it is something else."""
        if d.get("version") != forcemap.VERSION:
            raise UsageError(f"force map of version {d.get('version')}: this one knows {forcemap.VERSION}")
        try:
            even, odd = np.array(d["even"], float), np.array(d["odd"], float)
            ln_D = None if d["ln_D"] is None else float(d["ln_D"])
            out = cls(even, odd, float(d["ln_F"]), ln_D, float(d.get("rms", "nan")))
        except (KeyError, TypeError, ValueError) as e:
            raise UsageError(f"not a force map: {e}") from None
        if even.shape != (forcemap.EVEN_IN, forcemap.EVEN_OUT) or odd.shape != (HALF, HALF):
            wanted = f"{forcemap.EVEN_IN} x {forcemap.EVEN_OUT} and {HALF} x {HALF}"
            raise UsageError(
                f"a force map for {ROWS} rows has {wanted} numbers, not {even.shape} and {odd.shape}"
            )
        if not (
            np.isfinite(even).all()
            and np.isfinite(odd).all()
            and np.isfinite([out.ln_F, out.ln_D or 0.0]).all()
        ):
            raise UsageError("the force map holds a number that is not finite")
        if out.ln_D is None and (even[list(_OF_THE_DEPTH)].any() or even[:, HALF].any()):
            raise UsageError("a force map of the pressure alone has coefficients of the displacement")
        return out

    def slopes(self, image: Floats, depth: Floats, ln_F: Floats | None = None) -> tuple[Floats, Floats]:
        """d q/d ln F (n, rows) and d ln D/d ln F (n,) of images (n, rows) in kPa and depths (n,) in mm.

        ln_F, by default, is that of the image's sum.
        """
        total = image.sum(1)
        q = image / total[:, None] * ROWS
        lf = (np.log(total) if ln_F is None else ln_F) - self.ln_F
        ld = np.zeros_like(lf) if self.ln_D is None else np.log(depth) - self.ln_D
        e = even_inputs(lf, ld, q) @ self.even
        o = _odd(q) @ self.odd
        return np.column_stack([e[:, :HALF] + o, (e[:, :HALF] - o)[:, ::-1]]), e[:, HALF]

    def move(self, image: Floats, depth: Floats, u: Floats) -> tuple[Floats, Floats]:
        """Images (n, rows), kPa, and depths (n,), mm, moved by u (n,) = ln(force wanted / force), in float64.

        The firmware's two-step midpoint rule, for checking it.
        """
        g, m = self.slopes(image, depth)
        mean = image.mean(1)
        half = image + (u / 2 * mean)[:, None] * g
        g, m = self.slopes(half, depth * np.exp(u / 2 * m), np.log(image.sum(1)) + u / 2)
        return image + (u * half.mean(1))[:, None] * g, depth * np.exp(u * m)


def even_inputs(lf: Floats, ld: Floats, q: Floats) -> Floats:
    """The inputs of the even half, (n, forcemap.EVEN_IN)."""
    return np.column_stack([np.ones_like(lf), lf, ld, lf * lf, lf * ld, ld * ld, _even(q) - 1])


def _even(q: Floats) -> Floats:
    return 0.5 * (q[:, :HALF] + q[:, : HALF - 1 : -1])


def _odd(q: Floats) -> Floats:
    return 0.5 * (q[:, :HALF] - q[:, : HALF - 1 : -1])


def fit(
    low_kPa: Floats,
    low_mm: Floats,
    high_kPa: Floats,
    high_mm: Floats,
    *,
    seed: int = 0,
    displacement: bool = True,
) -> ForceMap:
    """Fit the map to images and depths at the same places under two forces.

    Parameters
    ----------
    low_kPa, high_kPa : ndarray (n, rows)
        Images at the lower and the higher force.
    low_mm, high_mm : ndarray (n,)
        Displacements.
    seed : int
        Of the noise given to the inputs.
    displacement : bool
        Whether the map may use it; a map of the pressure alone serves recordings that have none.
    """
    low_kPa, high_kPa = np.asarray(low_kPa, float), np.asarray(high_kPa, float)
    if low_kPa.shape != high_kPa.shape or low_kPa.ndim != 2 or low_kPa.shape[1] != ROWS:
        raise UsageError(f"images of shapes {low_kPa.shape} and {high_kPa.shape}: both must be (n, {ROWS})")
    if len(low_kPa) < 100:
        raise UsageError(f"{len(low_kPa)} pairs of images are too few to fit a force map: give 100 or more")
    both = (low_kPa > 0.3) & (high_kPa > 0.3)
    middle = np.where(both, np.sqrt(np.maximum(low_kPa * high_kPa, 0)), (low_kPa + high_kPa) / 2)
    step = np.log(high_kPa.sum(1) / low_kPa.sum(1))
    if np.any(step < 0.01):
        raise UsageError("the second image of each pair must be the one pressed harder")
    target = (high_kPa - low_kPa) / step[:, None] / middle.sum(1)[:, None] * ROWS
    target_depth = np.log(high_mm / low_mm) / step
    rng = np.random.default_rng(seed)
    image = middle + _NOISE_KPA * rng.standard_normal(middle.shape)
    lf, ld = np.log(image.sum(1)), 0.5 * np.log(np.asarray(low_mm) * high_mm)
    ln_F, ln_D = float(lf.mean()), float(ld.mean())
    q = image / image.sum(1)[:, None] * ROWS
    inputs = even_inputs(lf - ln_F, ld - ln_D, q)
    if displacement:
        even = _ridge(inputs, np.column_stack([_even(target), target_depth]))
    else:
        even = np.zeros((forcemap.EVEN_IN, forcemap.EVEN_OUT))
        used = np.setdiff1d(np.arange(forcemap.EVEN_IN), _OF_THE_DEPTH)
        even[used, :HALF] = _ridge(inputs[:, used], _even(target))
    odd = _ridge(_odd(q), _odd(target))
    out = ForceMap(even, odd, ln_F, ln_D if displacement else None)
    residual = out.slopes(image, np.exp(ld))[0] - target
    return replace(out, rms=float(np.sqrt((residual**2).mean())))


def _ridge(x: Floats, y: Floats) -> Floats:
    """Coefficients on the grid of 2^-FINEST (or coarser) that the firmware holds.

    They are rounded one after the other, and those still free take up what rounding has cost (as in
    optimal brain quantisation: Frantar and Alistarh 2022), so that packing the map changes nothing. Of few
    strokes, which leave coefficients larger than can be packed, the ridge is as strong as that asks for.
    """
    size = np.sqrt((x * x).mean(0)) + 1e-12
    for ridge in _RIDGE * 10.0 ** np.arange(6):
        H = x.T @ x / len(x) + ridge * np.diag(size**2)
        free = np.linalg.solve(H, x.T @ y / len(x))
        if 1.05 * np.abs(free).max() < _LARGEST:
            break
    grid = 2.0 ** -_shift(1.05 * np.abs(free).max())
    out = np.empty_like(free)
    left = list(range(len(free)))
    while left:
        inverse = np.linalg.inv(H[np.ix_(left, left)])
        i = left[0]
        out[i] = np.rint(free[i] / grid) * grid
        free[left] -= np.outer(inverse[:, 0] / inverse[0, 0], free[i] - out[i])
        left.pop(0)
    return out


def _shift(largest: float) -> int:
    """The finest Q format, up to FINEST, in which 16 bits hold a number so large."""
    shift = FINEST
    while shift >= COARSEST and np.rint(largest * 2.0**shift) > 32767:
        shift -= 1
    if shift < COARSEST:
        raise UsageError(f"a coefficient of the force map is {largest:.3g}: 8 and more cannot be packed")
    return shift


def blob(force_map: ForceMap | dict[str, Any], count_mpa: int = geometry.COUNT_MPA) -> bytes:
    """Pack the map for firmware_py.forcemap.load.

    Parameters
    ----------
    force_map : ForceMap or dict
        What `fit` returned, or its `as_dict`.
    count_mpa : int
        The probe's nominal count in millipascal, since the firmware works in counts.
    """
    m = force_map if isinstance(force_map, ForceMap) else ForceMap.from_dict(force_map)
    flat = np.concatenate([m.even.ravel(), m.odd.ravel()])
    shift = _shift(np.abs(flat).max())
    ln_F = m.ln_F + np.log(1e6 / count_mpa * Q5_PER_COUNT)
    ln_D = 0.0 if m.ln_D is None else m.ln_D + np.log(DEPTH_UNITS_PER_MM)
    centres = np.rint(np.array([ln_F, ln_D]) * 2**24)
    if np.abs(centres).max() >= 2**29:
        raise UsageError("the force map's centres are out of range: are its units kPa and mm?")
    head = bytes([0x46, forcemap.VERSION, shift, 0])
    return head + centres.astype("<i4").tobytes() + np.rint(flat * 2.0**shift).astype("<i2").tobytes()

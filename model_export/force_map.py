"""The force map: learned from pairs of strokes at two forces, packed for firmware_py.forcemap.

Every frame of a stroke is moved to the stroke's mean force by the derivatives dp/d ln F and
d ln D/d ln F. Both are linear in the relative image p / mean(p) and quadratic in ln F and ln D. Probe
and layers are symmetric, so the map is fitted to the even and odd halves of the image apart; q = p / mean(p).

Units: kPa, mm; ln F is the logarithm of the image's sum of 16 pressures in kPa.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import forcemap

Floats = NDArray[np.float64]

Q5_PER_COUNT = 32
DEPTH_UNITS_PER_MM = 16000
DEFAULT_COUNT_MPA = 6105
FINEST, COARSEST = 14, 12  # Q formats of the coefficients


@dataclass(frozen=True)
class ForceMap:
    """A fitted force map.

    Attributes
    ----------
    even : ndarray (14, 9)
        Inputs 1, lnF, lnD, lnF^2, lnF lnD, lnD^2 (less their centres) and (q_i + q_15-i)/2 - 1, i = 0..7;
        outputs the even half of d q_i/d ln F, i = 0..7, and d ln D/d ln F.
    odd : ndarray (8, 8)
        From (q_i - q_15-i)/2 to the odd half.
    ln_F, ln_D : float
        Centres of ln(sum of the image / kPa) and ln(D / mm).
    rms : float
        Residual of the fit, of the image's mean, over all sensors.
    """

    even: Floats
    odd: Floats
    ln_F: float
    ln_D: float
    rms: float = float("nan")

    def as_dict(self) -> dict[str, Any]:
        """What travels in model.json."""
        out = asdict(self)
        return out | {"version": forcemap.VERSION, "even": self.even.tolist(), "odd": self.odd.tolist()}

    @classmethod
    def from_dict(cls, d: dict[str, Any]) -> ForceMap:
        """Read back what `as_dict` wrote; ValueError if it is something else."""
        if d.get("version") != forcemap.VERSION:
            raise ValueError(f"force map of version {d.get('version')}: this one knows {forcemap.VERSION}")
        try:
            even, odd = np.array(d["even"], float), np.array(d["odd"], float)
            out = cls(even, odd, float(d["ln_F"]), float(d["ln_D"]), float(d.get("rms", "nan")))
        except (KeyError, TypeError, ValueError) as e:
            raise ValueError(f"not a force map: {e}") from None
        if even.shape != (forcemap.EVEN_IN, forcemap.EVEN_OUT) or odd.shape != (8, 8):
            raise ValueError(f"a force map has 14 x 9 and 8 x 8 numbers, not {even.shape} and {odd.shape}")
        if not (
            np.isfinite(even).all() and np.isfinite(odd).all() and np.isfinite([out.ln_F, out.ln_D]).all()
        ):
            raise ValueError("the force map holds a number that is not finite")
        return out

    def slopes(self, image: Floats, depth: Floats, ln_F: Floats | None = None) -> tuple[Floats, Floats]:
        """d q/d ln F (n, 16) and d ln D/d ln F (n,) of images (n, 16) in kPa and depths (n,) in mm.

        ln_F, by default, is that of the image's sum.
        """
        total = image.sum(1)
        q = image / total[:, None] * 16
        lf = (np.log(total) if ln_F is None else ln_F) - self.ln_F
        ld = np.log(depth) - self.ln_D
        e = even_inputs(lf, ld, q) @ self.even
        o = 0.5 * (q[:, :8] - q[:, :7:-1]) @ self.odd
        return np.column_stack([e[:, :8] + o, (e[:, :8] - o)[:, ::-1]]), e[:, 8]

    def move(self, image: Floats, depth: Floats, u: Floats) -> tuple[Floats, Floats]:
        """Images (n, 16) and depths (n,) moved by u (n,) = ln(force wanted / force), in float64.

        The firmware's two-step midpoint rule, for checking it.
        """
        g, m = self.slopes(image, depth)
        mean = image.mean(1)
        half = image + (u / 2 * mean)[:, None] * g
        g, m = self.slopes(half, depth * np.exp(u / 2 * m), np.log(image.sum(1)) + u / 2)
        return image + (u * half.mean(1))[:, None] * g, depth * np.exp(u * m)


def even_inputs(lf: Floats, ld: Floats, q: Floats) -> Floats:
    """The 14 inputs of the even half, (n, 14)."""
    return np.column_stack(
        [np.ones_like(lf), lf, ld, lf * lf, lf * ld, ld * ld, 0.5 * (q[:, :8] + q[:, :7:-1]) - 1]
    )


def fit(
    low_kPa: Floats,
    low_mm: Floats,
    high_kPa: Floats,
    high_mm: Floats,
    *,
    noise_kPa: float = 0.012,
    ridge: float = 1e-4,
    seed: int = 0,
) -> ForceMap:
    """Fit the map to images and depths at the same places under two forces.

    Parameters
    ----------
    low_kPa, high_kPa : ndarray (n, 16)
        Images at the lower and the higher force.
    low_mm, high_mm : ndarray (n,)
        Displacements.
    noise_kPa : float
        Noise given to the inputs, so that the map does not rely on what a sensor cannot show; by default
        white noise of .25 % of 25 kPa over 26 columns.
    ridge : float
        Relative ridge.
    """
    low_kPa, high_kPa = np.asarray(low_kPa, float), np.asarray(high_kPa, float)
    if low_kPa.shape != high_kPa.shape or low_kPa.ndim != 2 or low_kPa.shape[1] != 16:
        raise ValueError(f"images of shapes {low_kPa.shape} and {high_kPa.shape}: both must be (n, 16)")
    if len(low_kPa) < 100:
        raise ValueError(f"{len(low_kPa)} pairs of images are too few to fit a force map: give 100 or more")
    both = (low_kPa > 0.3) & (high_kPa > 0.3)
    middle = np.where(both, np.sqrt(np.maximum(low_kPa * high_kPa, 0)), (low_kPa + high_kPa) / 2)
    step = np.log(high_kPa.sum(1) / low_kPa.sum(1))
    if np.any(step < 0.01):
        raise ValueError("the second image of each pair must be the one pressed harder")
    target = (high_kPa - low_kPa) / step[:, None] / middle.sum(1)[:, None] * 16
    target_depth = np.log(high_mm / low_mm) / step
    rng = np.random.default_rng(seed)
    image = middle + noise_kPa * rng.standard_normal(middle.shape)
    lf, ld = np.log(image.sum(1)), 0.5 * np.log(np.asarray(low_mm) * high_mm)
    ln_F, ln_D = float(lf.mean()), float(ld.mean())
    q = image / image.sum(1)[:, None] * 16
    even = _ridge(
        even_inputs(lf - ln_F, ld - ln_D, q),
        np.column_stack([0.5 * (target[:, :8] + target[:, :7:-1]), target_depth]),
        ridge,
    )
    odd = _ridge(0.5 * (q[:, :8] - q[:, :7:-1]), 0.5 * (target[:, :8] - target[:, :7:-1]), ridge)
    out = ForceMap(even, odd, ln_F, ln_D)
    residual = out.slopes(image, np.exp(ld))[0] - target
    return ForceMap(even, odd, ln_F, ln_D, float(np.sqrt((residual**2).mean())))


def _ridge(x: Floats, y: Floats, ridge: float) -> Floats:
    """Coefficients on the grid of 2^-FINEST (or coarser) that the firmware holds.

    They are rounded one after the other, and those still free take up what rounding has cost (as in
    optimal brain quantisation: Frantar and Alistarh 2022), so that packing the map changes nothing.
    """
    size = np.sqrt((x * x).mean(0)) + 1e-12
    H = x.T @ x / len(x) + ridge * np.diag(size**2)
    free = np.linalg.solve(H, x.T @ y / len(x))
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
        raise ValueError(f"a coefficient of the force map is {largest:.3g}: 8 and more cannot be packed")
    return shift


def blob(force_map: ForceMap | dict[str, Any], count_mpa: int = DEFAULT_COUNT_MPA) -> bytes:
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
    ln_D = m.ln_D + np.log(DEPTH_UNITS_PER_MM)
    centres = np.rint(np.array([ln_F, ln_D]) * 2**24)
    if np.abs(centres).max() >= 2**29:
        raise ValueError("the force map's centres are out of range: are its units kPa and mm?")
    head = bytes([0x46, forcemap.VERSION, shift, 0])
    return head + centres.astype("<i4").tobytes() + np.rint(flat * 2.0**shift).astype("<i2").tobytes()

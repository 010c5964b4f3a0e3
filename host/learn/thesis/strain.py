"""Strain-force curves F = A S^B (thesis, Figures 15, 16 and 21)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
import statsmodels.api as sm
from numpy.typing import ArrayLike

from palpate.features.map_features import Floats
from palpate.learn.table import SYMBOL_OF, TableError, r_squared


@dataclass(frozen=True)
class StrainForce:
    """F = A S^B, fitted in logarithms.

    Attributes
    ----------
    A, B : float
        F in the unit that came in; S is the nominal strain, displacement over thickness.
    r2 : float
        Of the force itself.
    strain, force : arrays
        The points fitted.
    label : str
    """

    A: float
    B: float
    r2: float
    strain: Floats
    force: Floats
    label: str = ""

    def __call__(self, strain: ArrayLike) -> Floats:
        """Force at a strain."""
        return self.A * np.asarray(strain, float) ** self.B

    def text(self) -> str:
        """The curve in readable form."""
        return f"F = {self.A:.4g} S^{self.B:.3f}"


def fit_strain_force(strain: ArrayLike, force: ArrayLike, label: str = "") -> StrainForce:
    """Fit A S^B to two points or more.

    Raises
    ------
    TableError
        Fewer than two points, or a strain or force that is not above zero.
    """
    s, f = np.asarray(strain, float), np.asarray(force, float)
    if s.shape != f.shape or s.ndim != 1 or len(s) < 2:
        raise TableError("a strain-force curve needs at least two points, each with a strain and a force")
    if not (np.all(s > 0) and np.all(f > 0) and np.isfinite(s).all() and np.isfinite(f).all()):
        raise TableError("strains and forces must be above zero")
    result = sm.OLS(np.log(f), sm.add_constant(np.log(s), has_constant="add")).fit()
    A, B = float(np.exp(result.params[0])), float(result.params[1])
    return StrainForce(A, B, r_squared(f, A * s**B), s, f, label)


def curves_by(table: pd.DataFrame, names: Iterable[str]) -> list[StrainForce]:
    """One curve for each group of runs equal in `names` that holds two forces or more.

    Figure 15 groups by E at d = 10 mm, h = .8. The strain is that over the lump.
    """
    curves = []
    for key, rows in table.groupby(list(names), sort=True):
        if rows["F_rel"].nunique() < 2:
            continue
        label = ", ".join(
            f"{SYMBOL_OF[n]} = {v:g}" for n, v in zip(names, key if isinstance(key, tuple) else (key,))
        )
        curves.append(fit_strain_force(rows["D0_mm"] / rows["t_mm"], rows["F_rel"], label))
    return curves


@dataclass(frozen=True)
class Placed:
    """Where a measured curve lies among simulated ones.

    Attributes
    ----------
    E_inv23, E_ratio : float
        The stiffness whose curve would fit best, held to the range of the simulated ones.
    between : (str, str)
        The neighbours: "E = 2", or "softer than all", "stiffer than all".
    misfit : float
        Root mean square of the relative difference in force that remains: 0 lies on a curve of that family.
    """

    E_inv23: float
    E_ratio: float
    between: tuple[str, str]
    misfit: float


def place_among(
    measured: StrainForce, simulated: dict[float, StrainForce], force_scale: float = 1.0
) -> Placed:
    """Place a measured curve among simulated ones of known E (Figure 21 among Figure 15).

    At equal strain a stiffer lump needs more force: forces are compared at the measured strains.

    Parameters
    ----------
    measured : StrainForce
    simulated : dict
        E -> curve, two or more.
    force_scale : float
        Measured force that corresponds to a simulated force of 1. A rubber model's fat is not the
        simulation's: take the ratio of a curve measured without a lump to the simulated one (`scale_from`).
    """
    if len(simulated) < 2:
        raise TableError("a curve is placed among two simulated ones or more")
    E = np.array(sorted(simulated))
    ratio = np.array([np.log(simulated[e](measured.strain) * force_scale / measured.force) for e in E])
    excess = ratio.mean(axis=1)
    order = np.argsort(excess)
    at = float(np.interp(0.0, excess[order], (E ** (-2 / 3))[order]))
    k = int(np.searchsorted(excess[order], 0.0))
    names = ["softer than all", *(f"E = {E[j]:g}" for j in order), "stiffer than all"]
    near = ratio[np.argmin(np.abs(excess))]
    offset = 0.0 if 0 < k < len(E) else float(near.mean())
    spread = near - near.mean() + offset
    return Placed(at, at**-1.5, (names[k], names[k + 1]), float(np.sqrt(np.mean(spread**2))))


def scale_from(measured: StrainForce, simulated: StrainForce) -> float:
    """Factor from simulated to measured force: the same model, as the one without a lump, in both."""
    return float(np.exp(np.mean(np.log(measured.force / simulated(measured.strain)))))

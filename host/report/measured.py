"""Measurements beside simulations: a real tactile map (Figure 20), real force curves (Figure 21).

Units: mm, kPa; measured forces in whatever unit their tables have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from palpate.errors import NoSuchFile, UsageError
from palpate.features.gaussian import Floats, GaussianFit, fit_gaussian
from palpate.learn.thesis.strain import Placed, StrainForce, fit_strain_force, place_among, scale_from
from palpate.sim.tissue import LIKE_FAT, Case, load_curve

if TYPE_CHECKING:
    from rich.table import Table

    from palpate.stroke.stroke import FollowedStroke

FORCES = (0.2, 0.4, 0.6, 0.8, 1.0)
REFERENCE = Case.from_code("d10h08e10f10")
STIFFNESSES = (1.0, 2.0, 5.0, 10.0, 50.0, 1000.0)


@dataclass(frozen=True)
class RealMap:
    """A measured tactile map and its Gaussian (Figure 20)."""

    x_mm: Floats
    pressure_kPa: Floats
    fit: GaussianFit

    @property
    def residual_kPa(self) -> Floats:
        """Measured less fitted."""
        return self.pressure_kPa - self.fit.curve(self.x_mm)

    @property
    def r2(self) -> float:
        """Share of the map's variance that the Gaussian explains."""
        spread = np.sum((self.pressure_kPa - self.pressure_kPa.mean()) ** 2)
        return float(1 - np.sum(self.residual_kPa**2) / spread)


@dataclass(frozen=True)
class MeasuredMap:
    """A measured map with its Gaussian, force curves placed among the simulated ones, or both."""

    map: RealMap | None = None
    curves: list[tuple[StrainForce, Placed]] = field(default_factory=list)

    def tables(self) -> list[Table]:
        """What `palpate fit --recording` and `--weights` print."""
        from rich.table import Table

        out = []
        if self.map is not None:
            shown = Table("quantity", title="Measured tactile map (Figure 20)")
            shown.add_column("value", justify="right")
            for name, value in self._map_dict().items():
                shown.add_row(name, f"{value:.4g}")
            out.append(shown)
        if self.curves:
            title = "Measured force curves among the simulated ones (Figure 21)"
            shown = Table("table", "curve", title=title, caption="the softest sets the scale of the force")
            for name in ("R2", "acts like E", "misfit"):
                shown.add_column(name, justify="right")
            for one, placed in self.curves:
                row = (f"{one.r2:.4f}", f"{placed.E_ratio:.3g}", f"{100 * placed.misfit:.1f} %")
                shown.add_row(one.label, one.text(), *row)
            out.append(shown)
        return out

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return {
            "map": self._map_dict() or None,
            "force_curves": [
                {"table": one.label, "A": one.A, "B": one.B, "r2": one.r2, **asdict(placed)}
                for one, placed in self.curves
            ],
        }

    def _map_dict(self) -> dict[str, float]:
        return {} if self.map is None else asdict(self.map.fit) | {"r2": self.map.r2}


def measure(
    recording: Path | None = None, weights: Sequence[Path] = (), thickness_mm: float = 30.0
) -> MeasuredMap:
    """Read and fit what was measured.

    Parameters
    ----------
    recording : path, optional
        See `recorded_map`.
    weights : paths
        A table of force and displacement (mm) for each lump.
    thickness_mm : float
        Of the model that they were measured on.

    Raises
    ------
    NoSuchFile, UsageError, TableError
        A file is not there, or holds no such thing.
    """
    found = None if recording is None else recorded_map(recording)
    curves = [real_strain_force(path, thickness_mm) for path in weights]
    return MeasuredMap(found, placed_curves(curves) if curves else [])


def recorded_map(path: Path) -> RealMap:
    """The map of a table (.csv: place in mm, kPa), or of the most Gaussian stroke of a recording (.mcap)."""
    return real_map(path) if path.suffix != ".mcap" else most_gaussian(path)[1]


def most_gaussian(path: Path) -> tuple[FollowedStroke, RealMap]:
    """The stroke of a recording whose map is most like a Gaussian, and that map.

    Raises
    ------
    UsageError
        No stroke has a lump in its map.
    """
    from palpate.stroke.read import load_strokes

    found = []
    for stroke in load_strokes(path):
        if (m := stroke.map) is not None and m.fit is not None:
            x, p = np.asarray(m.x_mm), np.asarray(m.pressure_kPa)
            found.append((stroke, RealMap(x, p, fit_gaussian(x, p))))
    if not found:
        raise UsageError(f"{path} holds no stroke with a lump in its tactile map")
    return max(found, key=lambda one: one[1].r2)


def placed_curves(curves: Sequence[StrainForce]) -> list[tuple[StrainForce, Placed]]:
    """Each measured curve with its place among the simulated; the softest sets the scale of the force."""
    simulated = simulated_curves()
    scale = scale_from(min(curves, key=lambda c: c.A), simulated[1.0])
    return [(one, place_among(one, simulated, scale)) for one in curves]


@lru_cache(maxsize=1)
def simulated_curves() -> dict[float, StrainForce]:
    """E -> curve of the reference lump with that stiffness; some seconds, once."""
    return {E: pressed(replace(REFERENCE, E_ratio=max(E, LIKE_FAT)), f"E = {E:g}") for E in STIFFNESSES}


def pressed(case: Case, label: str) -> StrainForce:
    """Press on the lump with all forces, and fit A S^B."""
    strokes = load_curve(case, FORCES)
    return fit_strain_force([float(s.strain[0]) for s in strokes], FORCES, label)


def read_columns(path: str | PathLike[str], wanted: int, what: str) -> pd.DataFrame:
    """The first `wanted` columns of a CSV or Parquet table as floats, rows with an empty cell left out.

    Raises
    ------
    NoSuchFile, UsageError
        It is not there, has too few columns, or a cell is not a number.
    """
    path = Path(path)
    if not path.is_file():
        raise NoSuchFile(f"there is no file {path}")
    try:
        table = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path, comment="#")
        if path.suffix != ".parquet" and all(_is_number(name) for name in table.columns):
            table = pd.read_csv(path, comment="#", header=None)
        if table.shape[1] < wanted:
            raise UsageError(f"{path} has {table.shape[1]} columns; {what} needs {wanted}")
        return table.iloc[:, :wanted].astype(float).dropna().reset_index(drop=True)
    except UsageError:
        raise
    except (ValueError, pd.errors.ParserError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} is not a table of numbers: {str(error).splitlines()[0]}") from None


def real_map(path: str | PathLike[str]) -> RealMap:
    """Read a table of places (mm) and pressures (kPa) and fit a Gaussian on a base to it."""
    table = read_columns(path, 2, "a tactile map (place in mm, pressure in kPa)")
    x, p = table.iloc[:, 0].to_numpy(), table.iloc[:, 1].to_numpy()
    order = np.argsort(x, kind="stable")
    return RealMap(x[order], p[order], fit_gaussian(x[order], p[order]))


def real_strain_force(path: str | PathLike[str], thickness_mm: float) -> StrainForce:
    """Read a table of forces and displacements (mm) and fit F = A S^B, S = displacement / thickness."""
    if not thickness_mm > 0:
        raise UsageError(f"the thickness must be above zero, not {thickness_mm:g} mm")
    table = read_columns(path, 2, "a force curve (force, displacement in mm)")
    force, displacement = table.iloc[:, 0].to_numpy(), table.iloc[:, 1].to_numpy()
    keep = displacement > 0
    return fit_strain_force(displacement[keep] / thickness_mm, force[keep], Path(path).stem)


def _is_number(text: object) -> bool:
    try:
        float(str(text))
    except ValueError:
        return False
    return True

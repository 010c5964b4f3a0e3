"""Measured tables beside simulated strokes: a real tactile map (Figure 20), a real force curve (Figure 21).

Units: mm, kPa; forces in whatever unit the table has.
"""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
import pandas as pd

from palpate.errors import NoSuchFile, UsageError
from palpate.features.gaussian import Floats, GaussianFit, fit_gaussian
from palpate.learn.thesis.strain import StrainForce, fit_strain_force


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

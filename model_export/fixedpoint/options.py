"""What `compile`, `from_sklearn` and `from_statsmodels` take beside a model and its data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from palpate.fixedpoint import assembly, data
from palpate.fixedpoint.assembly import Model
from palpate.fixedpoint.calibration import Calibration
from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.program import Program
from palpate.fixedpoint.space import Array, Space


@dataclass(frozen=True, kw_only=True)
class Options:
    """All of them optional.

    Attributes
    ----------
    units : list of str
        Of the outputs.
    calibrate : (X, y)
        Data that the model was not fitted to: adds split-conformal intervals and a domain flag.
    level : float
        Of the intervals.
    names, output_names : list of str
    box : list of (float, float), or dict by name
        The features' ends; by default those of X and a tenth more on each side, but not across zero.
    steps : list of float, or dict by name
        What an integer of 1 of each feature stands for; by default 1 where X holds whole numbers.
    within : list of float
        The worst error wanted of each output, in its unit; by default a hundred thousandth of its standard
        deviation. A larger one makes a quicker program; `Program.errors` says what came of it.
    precise : str
        "box": errors are that small over the whole box; "data": for rows like those of X, in fewer words.
    """

    units: Sequence[str] | None = None
    calibrate: tuple[Any, Any] | None = None
    level: float = 0.9
    names: Sequence[str] | None = None
    output_names: Sequence[str] | None = None
    box: data.Box = None
    steps: data.Steps = None
    within: Sequence[float] | None = None
    precise: str = "box"

    def features(self, n: int, columns: Sequence[str] | None = None) -> list[str]:
        """Names of the n features."""
        return data.named(self.names or columns, n, "x")

    def space(self, table: Array, columns: Sequence[str] | None) -> Space:
        """The features of a table."""
        words = self.features(table.shape[1], columns)
        return Space(data.features(table, words, self.box, self.steps))

    def program(self, model: Model, X: Array | None, columns: Sequence[str] | None) -> Program:
        """The program of a model that has been read: named, as exact as is wanted, calibrated."""
        n = len(model.polys)
        if model.classes:
            if self.calibrate is not None:
                raise CompileError("intervals are of regressions; leave calibrate out for a classifier")
        else:
            model.names = data.named(self.output_names, n, "y")
        units = list(self.units or [""] * n)
        if len(units) != n and not model.classes:
            raise CompileError(f"units has {len(units)} entries for {n} outputs")
        model.units = (units + [""] * n)[:n]
        model.within, model.precise = data.tolerances(self.within, n, self.precise), self.precise
        calibration = None
        if self.calibrate is not None:
            n_features = len(model.space.features)
            calibration = Calibration.of(
                self.calibrate, n_features, columns, model.reference, model.links, self.level
            )
        return assembly.build(model, X, calibration)

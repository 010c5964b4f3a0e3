"""`fit`: from a directory of strokes to a model, of either kind."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.errors import UsageError
from palpate.learn.observed import noise_named
from palpate.learn.result import TissueFit
from palpate.learn.table import TableError
from palpate.learn.thesis.fit import ThesisFit
from palpate.model_export.schema import ModelSpec
from palpate.progress import ProgressCallback
from palpate.sim.tissue import Stroke

if TYPE_CHECKING:
    from rich.table import Table

    from palpate.learn.scopes import Scope

KINDS = ("thesis", "field")


@dataclass(frozen=True)
class Fit:
    """A fitted model and what is known about it.

    Attributes
    ----------
    kind : str
        "thesis" or "field".
    spec : ModelSpec
        The model itself: what `save` writes and `palpate.export` compiles and signs.
    result : ThesisFit or TissueFit
        Every number behind the tables.
    strokes : list of Stroke
        The thesis' runs; empty for the field kind, which has thousands.
    """

    kind: str
    spec: ModelSpec
    result: ThesisFit | TissueFit
    strokes: list[Stroke] = field(default_factory=list, repr=False)

    def tables(self) -> list[Table]:
        """What `palpate fit` prints, as tables of the library `rich`."""
        return self.result.tables()

    def to_dict(self) -> dict[str, Any]:
        """The same as plain numbers, for JSON."""
        return {"kind": self.kind, **self.result.to_dict()}

    def save(self, path: str | PathLike[str]) -> None:
        """Write model.json, whole or not at all."""
        self.spec.save(path)


def fit(
    directory: str | PathLike[str],
    kind: str = "thesis",
    *,
    noise: str = "typical",
    seed: int = 1,
    lumps: int | None = None,
    workers: int | None = None,
    tissue: Mapping[str, float] | None = None,
    displacement: bool = True,
    anywhere: bool = False,
    progress: ProgressCallback | None = None,
) -> Fit:
    """Fit a model to the strokes in a directory, as `palpate fit` does.

        fitted = fit("out/thesis")
        fitted.save("out/model.json")

    Parameters
    ----------
    directory : path
        thesis: a sweep of the thesis' design. field: strokes over lumps of all kinds, endless cylinders; what
        is missing is simulated into it first. Where it holds balls.parquet (`palpate sweep --keep`) the model
        is for the balls and ellipsoids in there.
    kind : str
        "thesis" (the 29 runs and the thesis' equations) or "field" (for use).
    noise : str
        Sensors to train for: a level of `palpate.sim.probe.noise.LEVELS`, or a sensor.toml.
    seed : int
        Of the split and of the sensors' noise.
    lumps : int, optional
        field: how many to simulate where the directory holds none; by default as many as
        Palpate's own models were fitted to.
    workers : int, optional
        field: processes; by default one for each core.
    tissue : mapping, optional
        field: None makes a model for tissue of all kinds. Otherwise it is told that the tissue is the
        thesis' but for these fields of `Case`, as {} or {"gland_ratio": 8}.
    displacement : bool
        field, told its tissue: False makes a model of the pressure alone, for recordings without
        displacement.
    anywhere : bool
        field, of tissue of all kinds: simulate lumps that lie anywhere, not only on the border of fat and
        gland, and tell the layer that they lie in. A directory that holds such lumps needs no telling.
    progress : callable, optional
        See `progress.ProgressCallback`.

    Raises
    ------
    UsageError
        There is no such kind, noise level or field of a case; the thesis kind is asked to do without
        displacement; field: `directory` looks like a mistyped name, and `lumps` does not say that it is not.
    TableError
        The directory holds no strokes, or strokes over another tissue, or over lumps on the border where
        they were to lie anywhere.
    """
    noise_named(noise)
    check_kind(kind, displacement, tissue is not None, anywhere)
    if kind not in KINDS:
        raise UsageError(f"there is no kind of model {kind!r}; there are {', '.join(KINDS)}")
    from palpate.sim.tissue.one_thread import one_blas_thread

    if kind == "thesis":
        from palpate.learn.thesis.fit import fit_thesis
        from palpate.learn.thesis.polynomial import fit_thesis_model
        from palpate.learn.thesis.runs import features_table, read_strokes

        runs = read_strokes(directory)
        with one_blas_thread():  # on a busy machine several threads wait for each other longer than they work
            found = fit_thesis(features_table(runs), progress=progress)
            spec = fit_thesis_model(runs, seed=seed, noise=noise, progress=progress)
        return Fit("thesis", spec, found, runs)
    from palpate.learn import data

    data.check_begun(directory, lumps)
    home = Path(directory)
    scope = _scope(home, tissue, displacement, anywhere)
    if scope.design is None:
        from palpate.learn.lumps import read_solid_rim, read_solids
        from palpate.learn.solid import fit_to_balls

        with one_blas_thread():
            solids, rim, many = read_solids(home), read_solid_rim(home), workers or os.cpu_count() or 1
            result = fit_to_balls(solids, noise, seed, workers=many, progress=progress, rim=rim)
    else:
        from palpate.learn.cylinders import fit_to_cylinders

        strokes = data.prepare_strokes(home, lumps or data.LUMPS, workers, progress, scope)
        with one_blas_thread():
            result = fit_to_cylinders(strokes, noise, seed, progress=progress, scope=scope)
    return Fit("field", result.spec, result)


def check_kind(kind: str, displacement: bool, told: bool, anywhere: bool = False) -> None:
    """`UsageError` where the kind cannot do what is asked of it."""
    if kind == "thesis" and not displacement:
        raise UsageError("the thesis' equations need the displacement: only --kind field does without")
    if kind == "thesis" and told:
        raise UsageError("the thesis' equations know one tissue: --tissue goes with --kind field")
    if kind == "field" and not told and not displacement:
        raise UsageError("--without displacement is for a model that is told its tissue: add --tissue thesis")
    if anywhere and (kind != "field" or told):
        raise UsageError("--anywhere is for a field model in tissue of all kinds: --kind field, no --tissue")


def _scope(home: Path, tissue: Mapping[str, float] | None, displacement: bool, anywhere: bool) -> Scope:
    """What a field model is for, by what is asked and what the directory holds; raises as `fit`."""
    from palpate.learn.data import check_tissue_names, lie_anywhere
    from palpate.learn.lumps import holds_solids
    from palpate.learn.scopes import ANYWHERE, BORDER, PRESSURE_ONLY, SOLID, told

    if holds_solids(home):
        if tissue is not None or anywhere:
            what = "lie in tissue of all kinds: leave --tissue out"
            if anywhere:
                what = "lie on the border of fat and gland: leave --anywhere out"
            raise UsageError(f"the balls in {home} {what}")
        return SOLID
    if tissue is not None:
        scope = told(check_tissue_names(tissue))
        return scope if displacement else scope.of(PRESSURE_ONLY)
    held = lie_anywhere(home)
    if anywhere and held is False:
        raise TableError(f"{home} holds lumps on the border of fat and gland: name another directory")
    return ANYWHERE if anywhere or held else BORDER

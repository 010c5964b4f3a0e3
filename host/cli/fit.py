"""`palpate fit`: from strokes to a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from host.cli.output import console, json_option, note, print_json, watching
from host.errors import UsageError

if TYPE_CHECKING:
    from model_export.schema import ModelSpec


@click.command("fit")
@click.argument("directory", type=click.Path(path_type=Path, file_okay=False))
@click.option("--kind", type=click.Choice(["thesis", "field"]), default="thesis", show_default=True,
              help="thesis: the 29 runs, the thesis' equations. field: lumps of all kinds.")  # fmt: skip
@click.option("--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="As model.json.")
@click.option("--noise", default="typical", show_default=True,
              help="Sensors to train for: none, good, typical or poor.")  # fmt: skip
@click.option("--seed", default=1, show_default=True, help="Of the split and of the sensors' noise.")
@click.option("--lumps", default=None, type=click.IntRange(64),
              help="field: lumps to simulate where DIRECTORY holds none.")  # fmt: skip
@click.option("--workers", type=click.IntRange(1), help="field: processes for that; all cores by default.")
@click.option("--tissue", multiple=True, metavar="NAME=VALUE",
              help="field: another tissue or probe, as gland_ratio=8; may be repeated.")  # fmt: skip
@click.option("--studies", is_flag=True, help="field: all of palpate study too (an hour).")
@click.option("--report", type=click.Path(path_type=Path, file_okay=False), help="Draw the figures there.")
@click.option("--recording", type=click.Path(path_type=Path, dir_okay=False),
              help="A real stroke beside it: .mcap, or .csv of place in mm and kPa.")  # fmt: skip
@click.option("--weights", multiple=True, type=click.Path(path_type=Path, dir_okay=False),
              help="A real lump pressed: .csv of force, displacement in mm; one a lump.")  # fmt: skip
@click.option("--thickness", default=30.0, show_default=True, type=click.FloatRange(min=0, min_open=True),
              help="mm of the model that --weights was measured on.")  # fmt: skip
@json_option
def command(
    directory: Path,
    kind: str,
    out: Path,
    noise: str,
    seed: int,
    lumps: int | None,
    workers: int | None,
    tissue: tuple[str, ...],
    studies: bool,
    report: Path | None,
    recording: Path | None,
    weights: tuple[Path, ...],
    thickness: float,
    as_json: bool,
) -> None:
    """Fit a model to the strokes in DIRECTORY and say how good it is.

    \b
    thesis  Table 1 beside the thesis' numbers, in sample and left out
    field   the held-out table; what DIRECTORY lacks is simulated into it first

    \b
    Example:
      palpate sweep --design thesis --out out/thesis
      palpate fit out/thesis --kind thesis --out out/model.json
      palpate fit out/field --kind field --out out/field.json --report out/report
    """
    from host.measured import Measured, measure
    from sim.probe.sensors import LEVELS

    if noise not in LEVELS:
        raise UsageError(f"there is no noise level {noise!r}; there are {', '.join(LEVELS)}")
    # Read before the work: what is wrong with these files is said at once.
    measured = measure(recording, weights, thickness) if recording or weights else Measured()
    if kind == "thesis":
        strokes, fit, spec = _thesis(directory, noise, seed)
        words: dict[str, Any] = {"strokes": strokes, "thesis": fit}
    else:
        fit = _field(directory, noise, seed, lumps, workers, _tissue(tissue))
        if studies:
            fit = _with_studies(fit, directory, seed, workers)
        spec, words = fit.spec, {"field": fit}
    _save(spec, out)
    page = None
    if report is not None:
        from host.report import write_report

        page = write_report(report, recording=recording, weights=weights, thickness_mm=thickness, **words)
    if as_json:
        print_json(
            {"out": out, "kind": kind, "report": page, "measured": measured.to_dict(), **fit.to_dict()}
        )
        return
    for found in (*fit.tables(), *measured.tables()):
        console().print(found)
    note(f"wrote {out}" + (f" and {page}" if page else ""))


def _save(spec: ModelSpec, out: Path) -> None:
    from host.files import whole_file

    with whole_file(out) as path:
        spec.save(path)


def _thesis(directory: Path, noise: str, seed: int) -> tuple[Any, Any, ModelSpec]:
    from host.regression.runs import features_table, read_strokes
    from host.regression.thesis import fit_thesis
    from host.regression.thesis_model import fit_thesis_model

    strokes = read_strokes(directory)
    with watching() as watch:
        fit = fit_thesis(features_table(strokes), watch=watch)
        return strokes, fit, fit_thesis_model(strokes, seed=seed, noise=noise, watch=watch)


def _field(
    directory: Path, noise: str, seed: int, lumps: int | None, workers: int | None, tissue: dict[str, float]
) -> Any:
    from host.regression.field.data import LUMPS, prepare
    from host.regression.field.fit import fit_field

    with watching() as watch:
        strokes = prepare(directory, lumps or LUMPS, workers=workers, tissue=tissue, watch=watch)
        return fit_field(strokes, noise=noise, seed=seed, workers=workers, watch=watch)


def _with_studies(fit: Any, directory: Path, seed: int, workers: int | None) -> Any:
    from dataclasses import replace

    from host.regression.field.bench import Bench
    from host.regression.field.data import read
    from host.regression.field.study import STUDIES
    from host.regression.field.tissues import TISSUE_STUDY

    with watching() as watch, Bench(read(directory), seed, directory, workers, watch) as bench:
        return replace(fit, studies=[(s, s.table(bench, note)) for s in (*STUDIES.values(), TISSUE_STUDY)])


def _tissue(words: tuple[str, ...]) -> dict[str, float]:
    """NAME=VALUE pairs as fields of a case; UsageError names the field that there is none of."""
    from dataclasses import fields

    from sim.tissue import Case

    known = {f.name for f in fields(Case)} - {"d_mm", "h", "E_ratio", "F_rel"}
    out = {}
    for word in words:
        name, _, value = word.partition("=")
        if name not in known:
            raise UsageError(f"--tissue {word}: there is no {name!r}; there are {', '.join(sorted(known))}")
        try:
            out[name] = float(value)
        except ValueError:
            raise UsageError(f"--tissue {word}: {value!r} is not a number") from None
    return out

"""`palpate fit`: from strokes to a model."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from host.cli.output import console, json_option, note, print_json, progress
from host.errors import UsageError
from host.files import whole_file

if TYPE_CHECKING:
    from sim.tissue import Progress


@click.command("fit")
@click.argument("directory", type=click.Path(path_type=Path, file_okay=False))
@click.option("--kind", type=click.Choice(["thesis", "field"]), default="thesis", show_default=True,
              help="thesis: 29 runs, its equations; field: space-filling runs, for use.")  # fmt: skip
@click.option("--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="As model.json.")
@click.option("--report", type=click.Path(path_type=Path, file_okay=False),
              help="Write every figure and table of the thesis that the data can make here.")  # fmt: skip
@click.option("--noise", default="typical", show_default=True, help="Sensors to train for.")
@click.option("--seed", default=1, show_default=True, help="Of the sensors' noise.")
@click.option("--lumps", type=click.IntRange(16), default=1536, show_default=True,
              help="field: how many lumps to simulate where DIRECTORY holds none.")  # fmt: skip
@click.option(
    "--workers", type=click.IntRange(1), help="field: processes to simulate with; all cores by default."
)
@json_option
def command(
    directory: Path,
    kind: str,
    out: Path,
    report: Path | None,
    noise: str,
    seed: int,
    lumps: int,
    workers: int | None,
    as_json: bool,
) -> None:
    """Fit a model to strokes; print how well it does beside the thesis' numbers, always out of sample, too.

    The thesis kind takes the strokes of `palpate sweep --design thesis`. The field kind needs each lump at
    two forces and simulates into DIRECTORY what is missing there.

    \b
    Example:
      palpate sweep --design thesis --out out/thesis
      palpate fit out/thesis --kind thesis --out out/model.json --report out/report
      palpate fit out/field --kind field --out out/field.json --lumps 256
    """
    from sim.probe.sensors import LEVELS

    if noise not in LEVELS:
        raise UsageError(f"there is no noise level {noise!r}; use {', '.join(LEVELS)}")
    fit = _thesis if kind == "thesis" else _field
    spec, found, report_words = fit(directory, noise=noise, seed=seed, lumps=lumps, workers=workers)
    with whole_file(out) as path:
        spec.save(path)
    page = _report(report, report_words) if report is not None else None
    if as_json:
        print_json({"out": out, "kind": kind, "report": page, **found.to_dict()})
        return
    _print_tables(found.tables())
    note(f"wrote {out}" + (f" and {page}" if page else ""))


def _thesis(directory: Path, noise: str, seed: int, **_: Any) -> tuple[Any, Any, dict[str, Any]]:
    from host.regression.runs import features_table, read_strokes
    from host.regression.thesis import fit_thesis
    from host.regression.thesis_model import fit_thesis_model

    strokes = read_strokes(directory)
    fit = fit_thesis(features_table(strokes))
    return fit_thesis_model(strokes, seed=seed, noise=noise), fit, {"strokes": strokes, "thesis": fit}


def _field(
    directory: Path, noise: str, seed: int, lumps: int, workers: int | None
) -> tuple[Any, Any, dict[str, Any]]:
    from host.regression.field.data import prepare
    from host.regression.field.fit import fit_field

    with progress("strokes") as bar:
        tasks: dict[str, Any] = {}

        def show(part: str, now: Progress) -> None:
            if part not in tasks:
                tasks[part] = bar.add_task(f"simulating {part}")
            bar.update(tasks[part], completed=now.done, total=now.total)

        strokes = prepare(directory, lumps, max(16, lumps // 3), max(8, lumps // 12), workers, show=show)
    fit = fit_field(strokes, noise=noise, seed=seed, tell=note)
    return fit.spec, fit, {"field": fit}


def _report(directory: Path, words: dict[str, Any]) -> Path:
    from host.report import write_report

    with progress("figures and tables") as bar:
        task = bar.add_task("drawing", total=None)
        return write_report(directory, **words, progress=lambda name: bar.update(task, description=name))


def _print_tables(tables: Iterable[Any]) -> None:
    for table in tables:
        console().print(table)

"""`palpate validate`: how far a model can be believed on real strokes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate.cli.numbers import SEED
from palpate.cli.real import data_option, leave_out_option, load_data, load_model
from palpate.console import json_option, note, print_json, say, showing_progress, table
from palpate.first_time import announce

if TYPE_CHECKING:
    from palpate.validation.result import Validation


@click.command("validate")
@click.argument("model", type=click.Path(path_type=Path))
@data_option
@leave_out_option
@click.option(
    "--report", type=click.Path(path_type=Path, file_okay=False), help="Write a page with plots there."
)
@click.option("--seed", type=SEED, default=1, show_default=True, help="Of the resampling.")
@json_option
def command(model: Path, data: Path, leave_out: bool, report: Path | None, seed: int, as_json: bool) -> None:
    """Judge MODEL by strokes over lumps that are known: bias, limits of agreement, coverage, and a verdict.

    MODEL is a model.json, or `field`, the model that comes with Palpate. The strokes are taken from the
    recordings' frames, whatever model was on the probe. Intervals at 95 % resample whole lumps, so that
    repeated strokes do not count as new evidence.

    \b
    Example:
      palpate validate field --data set.csv --report out/validation
    """
    from palpate.validation.result import validate

    spec = load_model(model)
    found_data = load_data(data, spec, leave_out)
    announce(solver=False, firmware=True)
    with showing_progress() as progress:
        found = validate(spec, found_data, seed, progress)
    page = None
    if report is not None:
        from palpate.validation.report import write

        page = write(found, report, f"{model} against {data.name}")
    if as_json:
        print_json({"model": model, "data": data, "report": page, **found.to_dict()})
        return
    show(found)
    if page is not None:
        note(f"wrote {page}")


def show(found: Validation) -> None:
    """The tables and the verdicts, for people."""
    from palpate.dataset.answers import NAMES
    from palpate.validation.report import rows_of, shares_of

    rows = {name: rows_of(a) for name, a in found.agreements.items()}
    heads = [what for what, _ in next(iter(rows.values()))] if rows else []
    table(["", *heads], [[name, *(text for _, text in row)] for name, row in rows.items()])
    table(
        ["", *(f"called {word}" for word in found.confusion.columns)],
        [[f"{row[0]} lumps", *map(str, row[1:])] for row in found.confusion.itertuples()],
    )
    for what, text in shares_of(found):
        say(f"{what}: {text}")
    for name, verdict in found.verdicts.items():
        say(f"{NAMES[name]}: {verdict.text}")

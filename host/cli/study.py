"""`palpate study`: what a probe's designer wants to know, one table and figure each."""

from __future__ import annotations

import os
from pathlib import Path

import click

from palpate.cli.output import json_option, note, print_json, showing_progress, table
from palpate.errors import UsageError


@click.command("study")
@click.argument("name")
@click.argument("directory", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--lumps",
    default=600,
    show_default=True,
    help="Of any-tissue, anywhere, reference, noise-list: how many to simulate.",
)
@click.option("--seed", default=1, show_default=True, help="Of the split and of the sensors' noise.")
@click.option("--noise", default=None,
              help="Sensors but for what is varied: a level, or a file of palpate characterise; "
                   "typical by default (any-tissue: typical and real).")  # fmt: skip
@click.option("--figure", type=click.Path(path_type=Path, dir_okay=False), help="Draw it, as SVG or PNG.")
@json_option
def command(
    name: str,
    directory: Path,
    lumps: int,
    seed: int,
    noise: str | None,
    figure: Path | None,
    as_json: bool,
) -> None:
    """Retrain the field model with one thing about the probe, the hand or the tissue changed.

    DIRECTORY holds the strokes of `palpate fit --kind field`. NAME is one of

    \b
    noise bits pitch gain dead position force displacement forces learning
    tissue    (simulates other tissues into DIRECTORY first, a few minutes)
    computed  (simulates lumps at seven forces into DIRECTORY first, a few minutes)
    any-tissue  (needs nothing in DIRECTORY: simulates --lumps lumps in random tissue into it first)
    anywhere  (the same of lumps in the fat, on its border or in the gland; half an hour)
    reference   (the same lumps and a press beside each, the right one or one of another place or person)
    noise-list  (the bundled model on new lumps, --lumps of them, and what their noise may lack, one by one)
    balls     (which balls and ellipsoids are found, and how well each kind is told; of
              DIRECTORY/balls.parquet, which palpate sweep --design balls:N --keep writes)

    \b
    Example:
      palpate study noise out/field --figure noise.svg
    """
    from palpate.regression.field.bench import Bench
    from palpate.regression.field.computed import COMPUTED_STUDY
    from palpate.regression.field.data import pressed, read
    from palpate.regression.field.study import STUDIES, study_table
    from palpate.regression.field.tissues import TISSUE_STUDY
    from palpate.regression.observed import noise_named

    level = noise_named(noise or "typical")
    if name == "any-tissue":
        if figure is not None:
            raise UsageError("any-tissue has no figure: leave --figure out")
        _any_tissue(directory, lumps, seed, noise, as_json)
        return
    if name == "anywhere":
        if figure is not None:
            raise UsageError("anywhere has no figure: leave --figure out")
        _anywhere(directory, lumps, seed, noise or "typical", as_json)
        return
    if name == "reference":
        if figure is not None:
            raise UsageError("reference has no figure: leave --figure out")
        _reference(directory, lumps, seed, noise, as_json)
        return
    if name == "noise-list":
        if figure is not None or noise is not None:
            raise UsageError("noise-list has no figure, and names its noise itself: leave both out")
        _noise_list(directory, lumps, seed, as_json)
        return
    if name == "balls":
        if figure is not None:
            raise UsageError("balls has no figure: leave --figure out")
        _balls(directory, seed, noise, as_json)
        return
    studies = STUDIES | {study.name: study for study in (TISSUE_STUDY, COMPUTED_STUDY)}
    if name not in studies:
        known = ", ".join((*studies, "any-tissue", "anywhere", "reference", "noise-list", "balls"))
        raise UsageError(f"there is no study {name!r}; there are {known}")
    study = studies[name]
    with showing_progress() as progress:
        strokes = read(directory)
        if study is TISSUE_STUDY:
            strokes = pressed(strokes, directory, progress=progress)
        with Bench(strokes, seed, directory, progress=progress, noise=level) as bench:
            result = study.table(bench, tell=note)
    if figure is not None:
        from palpate.report.study_figures import save_study_figure

        save_study_figure(study, result, figure)
        note(f"wrote {figure}")
    if as_json:
        print_json({"study": name, "title": study.title, "rows": result.to_dict("records")})
        return
    heads, rows = study_table(study, result)
    table(heads, rows, study.title)


def _any_tissue(directory: Path, lumps: int, seed: int, noise: str | None, as_json: bool) -> None:
    from palpate.regression.any_tissue.study import LEVELS, prepare, table_of, text_of

    with showing_progress() as progress:
        levels = LEVELS if noise is None else (noise,)
        result = table_of(prepare(directory, lumps, progress=progress), levels, seed=seed, step=note)
    if as_json:
        print_json({"study": "any-tissue", "rows": result.to_dict("records")})
        return
    heads, rows = text_of(result)
    table(heads, rows, "Tissue that the probe knows nothing about")


def _anywhere(directory: Path, lumps: int, seed: int, noise: str, as_json: bool) -> None:
    from palpate.regression.anywhere.study import bounds, prepare, study

    with showing_progress() as progress:
        anywhere, tied = prepare(directory, lumps, progress=progress)
        known = bounds(anywhere, directory, noise, progress=progress)
        result = study(anywhere, tied, known, noise, seed, step=note)
    if as_json:
        print_json({"study": "anywhere", "tables": result.to_dict()})
        return
    for title, heads, rows in result.tables:
        table(heads, rows, title)


def _reference(directory: Path, lumps: int, seed: int, noise: str | None, as_json: bool) -> None:
    from palpate.regression.any_tissue.reference_study import prepare, table_of, text_of

    with showing_progress() as progress:
        found = prepare(directory, lumps, progress=progress)
        result = table_of(directory, found, (noise or "typical",), seed=seed, step=note)
    if as_json:
        print_json({"study": "reference", "rows": result.to_dict("records")})
        return
    heads, rows = text_of(result)
    table(heads, rows, "A reference press beside the lump")


def _noise_list(directory: Path, lumps: int, seed: int, as_json: bool) -> None:
    from palpate.regression.any_tissue.noise_list import prepare, study, text_of

    with showing_progress() as progress:
        rows = study(*prepare(directory, lumps, progress=progress), seed=seed, step=note)
    if as_json:
        print_json({"study": "noise-list", "rows": rows})
        return
    for title, heads, cells in text_of(rows):
        table(heads, cells, title)


def _balls(directory: Path, seed: int, noise: str | None, as_json: bool) -> None:
    from palpate.regression.balls.lumps import read_lumps
    from palpate.regression.balls.report import tables_of
    from palpate.sim.tissue.stroke import one_blas_thread

    with one_blas_thread():
        found = tables_of(read_lumps(directory), noise or "typical", seed, os.cpu_count() or 1, note)
    if as_json:
        print_json({"study": "balls", "tables": {one.name: one.records() for one in found}})
        return
    for one in found:
        table(*one.text, one.title)

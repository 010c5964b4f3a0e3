"""`palpate fit`: from strokes to a model."""

from __future__ import annotations

from pathlib import Path

import click

from host.cli.output import console, json_option, note, print_json


@click.command("fit")
@click.argument("directory", type=click.Path(path_type=Path, file_okay=False))
@click.option("--kind", type=click.Choice(["thesis"]), default="thesis", show_default=True,
              help="thesis: the 29 runs and the thesis' equations.")  # fmt: skip
@click.option("--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="As model.json.")
@click.option("--noise", default="typical", show_default=True, help="Sensors to train for.")
@click.option("--seed", default=1, show_default=True, help="Of the sensors' noise.")
@json_option
def command(directory: Path, kind: str, out: Path, noise: str, seed: int, as_json: bool) -> None:
    """Fit a model to the strokes of a sweep, and print Table 1 beside the thesis' numbers.

    \b
    Example:
      palpate sweep --design thesis --out out/thesis
      palpate fit out/thesis --kind thesis --out out/model.json
    """
    from host.files import whole_file
    from host.regression.runs import features_table, read_strokes
    from host.regression.thesis import fit_thesis
    from host.regression.thesis_model import fit_thesis_model

    strokes = read_strokes(directory)
    fit = fit_thesis(features_table(strokes))
    spec = fit_thesis_model(strokes, seed=seed, noise=noise)
    with whole_file(out) as path:
        spec.save(path)
    if as_json:
        print_json({"out": out, "kind": kind, "strokes": len(strokes), **fit.to_dict()})
        return
    for found in fit.tables():
        console().print(found)
    note(f"wrote {out}")

"""Run a study: python -m tests.studies NAME DIRECTORY; --help lists them."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import click

from palpate.cli.numbers import SEED
from palpate.cli.runner import run
from palpate.console import json_option, note, print_json, showing_progress, table
from palpate.errors import UsageError
from palpate.sim.tissue.one_thread import one_blas_thread
from tests.studies.table import Asked

TOLD = ("noise", "bits", "pitch", "dead", "force")
MODULES = {
    **dict.fromkeys(TOLD, "settings"),
    "tissue": "tissues",
    "coverage": "coverage",
    "anywhere": "anywhere",
    "reference": "reference",
    "departed": "departed",
    "inverted": "inverted",
    "inverted_solid": "inverted_solid",
    "on_border": "on_border",
    "outside": "outside",
    "phantoms": "phantoms",
    "pressed": "pressed",
    "ranges": "ranges",
    "unlike": "unlike",
}
"""Name of a study -> its module, with `tables(Asked)`, or `STUDIES` of the told model by name."""

RETRAINED = (*TOLD, "tissue")


@click.command("study")
@click.argument("name")
@click.argument("directory", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--lumps", default=None, type=click.IntRange(1), help="How many to simulate, where it simulates."
)
@click.option("--after", default=0, type=click.IntRange(0), help="So many of the first ones are left out.")
@click.option(
    "--seed", type=SEED, default=1, show_default=True, help="Of the split and of the sensors' noise."
)
@click.option("--noise", default=None, help="Sensors: a level, or a file of palpate characterise.")
@json_option
def command(
    name: str,
    directory: Path,
    lumps: int | None,
    after: int,
    seed: int,
    noise: str | None,
    as_json: bool,
) -> None:
    """Judge the product: what the probe, the hand, the tissue or the noise does to estimates.

    \b
    of a model that is told its tissue, retrained (DIRECTORY: of palpate fit --kind field --tissue thesis)
      noise bits pitch dead force
      tissue      other tissues, simulated into DIRECTORY first (minutes)
    of others (what DIRECTORY lacks is simulated into it)
      anywhere    lumps in the fat, on its border or in the gland; what the map would allow
      reference   a press beside the lump, the right one or one of another place or person
      coverage    the intervals of the bundled told model, the depth's among them
      departed    what no class holds (waves, friction, two lumps): how often a fit says so (minutes each)
      unlike      tissue and sensors a little unlike every model: held, or refused (a minute each)
      inverted    strokes fitted by the forward model: errors and intervals (a minute each)
      on_border   the same over lumps on the border of fat and gland
      inverted_solid  the same over balls and ellipsoids (minutes each, and two to compute each)
      outside     lumps outside the bundled models' ranges: flags, and strokes fitted (a minute each)
      phantoms    eight balls in one soft material, three strokes each, fitted together (minutes each)
      pressed     presses alone, fitted by the forward model (minutes each)
      ranges      the bundled models at the ends of their ranges and beyond (minutes)
    """
    if name not in MODULES:
        raise UsageError(f"there is no study {name!r}; there are {', '.join(MODULES)}")
    module = importlib.import_module(f"tests.studies.{MODULES[name]}")
    with showing_progress() as progress, one_blas_thread():
        asked = Asked(directory, lumps, seed, noise, progress, note, after)
        if name in RETRAINED:
            study = module.STUDIES[name]
            found = [study.shown(study.of_directory(asked))]
        else:
            found = module.tables(asked)
    if as_json:
        print_json({"study": name, "tables": [one.to_dict() for one in found]})
        return
    for one in found:
        table(one.heads, one.rows, one.title)


if __name__ == "__main__":
    sys.exit(run(command))

"""`palpate characterise`: a sensor's noise, measured from recordings."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.console import json_option, note, print_json, say, table
from palpate.files import check_writable


@click.command("characterise")
@click.argument("campaign", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="As sensor.toml.")
@json_option
def command(campaign: Path, out: Path, as_json: bool) -> None:
    """Measure a sensor from the recordings that CAMPAIGN lists: in air, under a cuff, over plain tissue.

    CAMPAIGN is a TOML file that says of each recording what it is of. Each number comes with its 95 %
    interval; what no recording tells is left out, and 0 in the noise. `fit --noise` and `emulate --noise`
    take the file that is written.

    \b
    Example:
      palpate characterise campaign.toml --out sensor.toml
      palpate emulate d12h07e20f09 --noise sensor.toml
    """
    from palpate.characterisation.campaign import read
    from palpate.characterisation.result import characterise

    check_writable(out)
    found = characterise(read(campaign))
    found.save(out)
    if as_json:
        print_json({"out": out, **found.to_dict()})
        return
    rows = [
        [name, f"{q.value:.3g}", f"{q.low:.3g} to {q.high:.3g}", q.of] for name, q in found.numbers.items()
    ]
    table(["", "value", "95 % interval", "of"], rows)
    dead, stuck = int(found.cells.dead.sum()), int(found.cells.stuck.sum())
    say(f"{dead} dead cells, {stuck} stuck ones, of {found.cells.dead.size}")
    note(f"wrote {out}")

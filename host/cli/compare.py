"""`palpate compare`: has a lump changed between two visits?"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from palpate.cli.real import load_model
from palpate.console import json_option, note, print_json, say, showing_progress
from palpate.errors import UsageError
from palpate.first_time import announce


@click.command("compare")
@click.argument("visit1", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("visit2", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--model", type=click.Path(path_type=Path),
              help="model.json, or a bundled model's name; default: the recordings' own.")  # fmt: skip
@click.option("--data", type=click.Path(path_type=Path, dir_okay=False),
              help="Data set with lumps visited again: what visits differ by themselves.")  # fmt: skip
@click.option("--refine", is_flag=True,
              help="Instead: fit the finite-element model to both visits together; minutes.")  # fmt: skip
@click.option("--noise", default="typical", show_default=True,
              help="Of --refine: of sensors and hand, a level or sensor.toml.")  # fmt: skip
@json_option
def command(
    visit1: Path, visit2: Path, model: Path | None, data: Path | None, refine: bool, noise: str, as_json: bool
) -> None:
    """Compare the strokes of two recordings over one lump: the change of each quantity, with its interval.

    Strokes outside what the model knows are left out. Without --data the intervals count how strokes of one
    visit differ. With a data set in which lumps were visited again they also count what differs between
    visits: zeroing, gain, force, place.

    Where both recordings have refined answers (`palpate refine`) their change is told, too. --refine needs no
    model: it fits all strokes as over one lump in one tissue, whose diameter and depth have changed. What
    both visits get wrong alike drops out.

    \b
    Example:
      palpate compare january.mcap may.mcap --data set.csv
      palpate compare january.mcap may.mcap --refine
    """
    from palpate.comparison.between import between_visits, common_model, compare_recordings
    from palpate.comparison.refined import change_text, kept_change
    from palpate.dataset import table
    from palpate.stroke.change import ASSUMES, ASSUMES_BETWEEN

    if refine:
        if model is not None or data is not None:
            raise UsageError("--refine takes neither --model nor --data: it fits the forward model itself")
        _refined(visit1, visit2, noise, as_json)
        return
    spec = common_model(visit1, visit2) if model is None else load_model(model)
    known = None if data is None else table.read(data)
    announce(solver=False, firmware=True)
    with showing_progress() as progress:
        between = {} if known is None else between_visits(spec, known, progress)
        found = compare_recordings(spec, visit1, visit2, between)
    kept = kept_change(visit1, visit2)
    assumes = ASSUMES_BETWEEN if between else ASSUMES
    if as_json:
        changes = {name: asdict(change) for name, change in found.changes.items()}
        visits = {name: asdict(b) for name, b in between.items()}
        apart = {name: ratio.as_dict() for name, ratio in kept.items()}
        more = {"refined_apart": apart, "left_out": found.left_out, "assumes": assumes}
        print_json({"changes": changes, "between_visits": visits, **more})
        return
    for path, n in zip((visit1, visit2), found.left_out):
        if n:
            note(f"{n} of the strokes of {path} left out: outside what the model knows")
    for change in found.changes.values():
        say(change.text)
    for name, b in between.items():
        note(f"{name} differs by {100 * b.sd:.1f} % from visit to visit ({b.freedom} degrees of freedom)")
    for name, ratio in kept.items():
        say(f"Refined, each visit by itself: {change_text(name, ratio)}")
    note(assumes)


def _refined(visit1: Path, visit2: Path, noise: str, as_json: bool) -> None:
    """Compare by the forward model."""
    from palpate.comparison.refined import ASSUMES, change_text, refined_change
    from palpate.sim.probe.noise import level_named

    level = level_named(noise)
    announce()
    found = refined_change(visit1, visit2, level)
    if as_json:
        print_json({**found.as_dict(), "assumes": ASSUMES})
        return
    before, after = (one.values["d_mm"].value for one in (found.before, found.after))
    misfit = f"Misfit {found.before.chi2:.2f}. Diameter {before:.1f} mm, then {after:.1f} mm."
    say(f"{found.before.verdict} {misfit}")
    for name, ratio in found.ratio.items():
        say(change_text(name, ratio))
    note(ASSUMES)

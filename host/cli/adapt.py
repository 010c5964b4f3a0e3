"""`palpate adapt`: a model corrected and recalibrated by real strokes."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.cli.real import data_option, leave_out_option, load_data, load_model
from palpate.console import json_option, note, print_json, say, showing_progress, table
from palpate.files import check_writable
from palpate.first_time import announce


@click.command("adapt")
@click.argument("model", type=click.Path(path_type=Path))
@data_option
@leave_out_option
@click.option(
    "--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="As adapted.json."
)
@json_option
def command(model: Path, data: Path, leave_out: bool, out: Path, as_json: bool) -> None:
    """Adapt MODEL to strokes over lumps that are known; five lumps at least.

    The simulated model stays the prior: a correction is only as large as leaving out whole lumps shows it to
    help. The intervals are recalibrated on left-out lumps, and before and after are shown on these. The
    adapted model exports and flashes as any other; its image says what it was adapted from.

    \b
    Example:
      palpate adapt field --data set.csv --out out/adapted.json
      palpate export out/adapted.json --key out/key --out out/adapted.palp
    """
    from palpate.adaptation.adapt import adapt_to
    from palpate.adaptation.left_out import before_and_after
    from palpate.dataset.strokes import observe_data_set

    spec = load_model(model)
    check_writable(out)
    found_data = load_data(data, spec, leave_out)
    announce(solver=False, firmware=True)
    with showing_progress() as progress:
        seen = observe_data_set(found_data, spec, progress)
        adapted = adapt_to(spec, seen)
        compared = before_and_after(spec, seen, progress)
    adapted.spec.save(out)
    if as_json:
        print_json({
            "out": out, "lumps": adapted.lumps, "strokes": adapted.strokes,
            "remarks": list(found_data.remarks),
            "outputs": {
                name: {"correction": c.words, "widths": adapted.widths[name], **compared.of(name)}
                for name, c in adapted.corrections.items()
            },
        })  # fmt: skip
        return
    table(*compared.as_table())
    for name, c in adapted.corrections.items():
        say(f"{name}: {c.words}; intervals {adapted.widths[name]:.2f} times as wide")
    note(f"wrote {out}, adapted to {adapted.strokes} strokes over {adapted.lumps} lumps")

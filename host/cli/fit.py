"""`palpate fit`: from strokes to a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate.cli.numbers import SEED, Finite
from palpate.console import console, json_option, note, print_json, showing_progress
from palpate.errors import UsageError
from palpate.files import check_writable
from palpate.first_time import announce
from palpate.sim.probe.noise import LEVELS

if TYPE_CHECKING:
    from palpate.report.items import Item


@click.command("fit")
@click.argument("directory", type=click.Path(path_type=Path, file_okay=False))
@click.option("--kind", type=click.Choice(["thesis", "field"]), default="thesis", show_default=True,
              help="thesis: the 29 runs, the thesis' equations. field: lumps of all kinds.")  # fmt: skip
@click.option("--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="As model.json.")
@click.option("--noise", default="typical", show_default=True,
              help=f"Sensors to train for: {', '.join(LEVELS)}, or a sensor.toml.")  # fmt: skip
@click.option(
    "--seed", type=SEED, default=1, show_default=True, help="Of the split and of the sensors' noise."
)
@click.option("--lumps", default=None, type=click.IntRange(64),
              help="field: lumps to simulate where DIRECTORY holds none.")  # fmt: skip
@click.option("--workers", type=click.IntRange(1), help="field: processes for that; all cores by default.")
@click.option("--tissue", multiple=True, metavar="thesis|NAME=VALUE",
              help="field: tell it its tissue: thesis, or as gland_ratio=8; may be repeated.")  # fmt: skip
@click.option("--anywhere", is_flag=True, help="field: lumps in the fat, in the gland, between.")
@click.option("--without", type=click.Choice(["displacement"]),
              help="field, told its tissue: the pressure alone, for recordings without it.")  # fmt: skip
@click.option("--report", type=click.Path(path_type=Path, file_okay=False), help="Draw the figures there.")
@click.option("--recording", type=click.Path(path_type=Path, dir_okay=False),
              help="A real stroke beside it: .mcap, or .csv of place in mm and kPa.")  # fmt: skip
@click.option("--weights", multiple=True, type=click.Path(path_type=Path, dir_okay=False),
              help="A real lump pressed: .csv of force, displacement in mm; one a lump.")  # fmt: skip
@click.option("--thickness", default=30.0, show_default=True, type=Finite(min=0, min_open=True),
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
    anywhere: bool,
    without: str | None,
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

    A field model is for tissue of all kinds, unless --tissue tells it one, and for lumps on the border of fat
    and gland, unless --anywhere has them lie as they come.

    \b
    Example:
      palpate sweep --design thesis --out out/thesis
      palpate fit out/thesis --kind thesis --out out/model.json
      palpate fit out/field --kind field --out out/field.json --report out/report
      palpate fit out/anywhere --kind field --anywhere --lumps 1000 --out out/anywhere.json
      palpate fit out/told --kind field --tissue thesis --out out/told.json
      palpate fit out/told --kind field --tissue thesis --without displacement --out out/pressure.json
    """
    from palpate.learn.data import begun, check_begun
    from palpate.learn.fit import check_kind, fit
    from palpate.learn.observed import noise_named
    from palpate.report.measured import MeasuredMap, measure
    from palpate.sim.tissue import check_finished

    # Read before the work: what is wrong with arguments and files is said at once.
    noise_named(noise)
    changed = _tissue(tissue)
    check_kind(kind, without is None, changed is not None, anywhere)
    if kind == "thesis" and (lumps is not None or workers is not None):
        raise UsageError("--lumps and --workers go with --kind field: the thesis' runs are a sweep's")
    check_writable(out)
    if kind == "field":
        check_begun(directory, lumps)
        if not begun(directory):
            note(
                f"{directory} holds no strokes yet: simulating them first; if stopped, it goes on from there"
            )
    else:
        check_finished(directory)
    measured = measure(recording, weights, thickness) if recording or weights else MeasuredMap()
    announce(solver=kind == "field", firmware=True)
    with showing_progress() as progress:
        fitted = fit(
            directory,
            kind,
            noise=noise,
            seed=seed,
            lumps=lumps,
            workers=workers,
            tissue=changed,
            displacement=without is None,
            anywhere=anywhere,
            progress=progress,
        )
    fitted.save(out)
    page = None
    if report is not None:
        from palpate.learn.thesis.fit import ThesisFit
        from palpate.report import write_report

        page = write_report(
            report,
            strokes=fitted.strokes,
            thesis=fitted.result if isinstance(fitted.result, ThesisFit) else None,
            field=None if isinstance(fitted.result, ThesisFit) else fitted.result,
            recording=recording,
            weights=weights,
            thickness_mm=thickness,
            more=_refined(recording),
        )
    if as_json:
        print_json({"out": out, "report": page, "measured": measured.to_dict(), **fitted.to_dict()})
        return
    for found in (*fitted.tables(), *measured.tables()):
        console().print(found)
    note(f"wrote {out}" + (f" and {page}" if page else ""))


def _tissue(pairs: tuple[str, ...]) -> dict[str, float] | None:
    """NAME=VALUE pairs as fields of a case; `UsageError` names what is wrong. None: nothing is told."""
    from palpate.learn.data import check_tissue_names

    if not pairs:
        return None
    tissue = {}
    for pair in pairs:
        if pair == "thesis":
            continue
        name, _, value = pair.partition("=")
        try:
            tissue[name] = float(value)
        except ValueError:
            raise UsageError(f"--tissue {pair}: {value!r} is not a number") from None
    return check_tissue_names(tissue)


def _refined(recording: Path | None) -> list[Item]:
    """What is kept of a recording's refined answers."""
    from palpate.inversion.kept import kept_answers
    from palpate.report import refined_figures

    if recording is None or recording.suffix != ".mcap":
        return []
    return refined_figures.items({recording: kept_answers(recording)})

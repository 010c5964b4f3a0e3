"""`palpate refine`: recorded strokes fitted by the finite-element model itself."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from palpate.console import json_option, note, print_json, progress, say
from palpate.errors import PalpateError, UsageError
from palpate.first_time import announce

if TYPE_CHECKING:
    from palpate.answer.fitted import Inverted, Value
    from palpate.inversion.kept import Kept
    from palpate.sim.probe.noise import Noise

KINDS = ("auto", "anywhere", "border", "none")


@click.command("refine")
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--class", "kind", type=click.Choice(KINDS), default="auto", show_default=True,
              help="What lies under the probe: a lump anywhere, one on the border of fat and gland, none; "
              "auto compares them.")  # fmt: skip
@click.option("--noise", default="typical", show_default=True,
              help="Of sensors and hand: a level, or sensor.toml of `palpate characterise`.")  # fmt: skip
@click.option("--face", "face_words", metavar="WORDS",
              help="Of somebody's array: radius=flat, or radius=40mm&padding=2mm&modulus=80kPa.")  # fmt: skip
@click.option("--together", is_flag=True,
              help="All strokes of all recordings go over one lump: one answer for them all.")  # fmt: skip
@click.option("--report", type=click.Path(path_type=Path, file_okay=False),
              help="Write a page there: estimates, fits, and the strokes laid over each other.")  # fmt: skip
@click.option("--again", is_flag=True, help="Fit anew what was fitted and kept before.")
@click.option("--workers", type=click.IntRange(1), default=1, show_default=True, help="Processes.")
@click.option("--scheduler", help="A Dask cluster instead: its address, as tcp://10.0.0.5:8786.")
@json_option
def command(
    recordings: tuple[Path, ...],
    kind: str,
    noise: str,
    face_words: str | None,
    together: bool,
    report: Path | None,
    again: bool,
    workers: int,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Fit the finite-element model to recorded strokes: size, depth, stiffness, and whether it fits.

    The probe's own answer is a regression. This takes seconds to a minute a stroke and works in any tissue
    that the solver knows; it says "does not fit" where no class of tissue and lump explains the stroke, or
    where undulating tissue or friction would do so better. Lumps are endless cylinders, one or two; where the
    image changes across the stroke, balls and ellipsoids, which take minutes.
    A recording without a stroke has its presses fitted: they tell less, and the intervals say how much.

    Answers are kept in RECORDING.refined, and taken from there until --again, another --class or --noise, or
    another version of Palpate's inversion asks for new ones.

    \b
    Example:
      palpate stream --strokes 1 --record visit.mcap
      palpate refine visit.mcap
    """
    from palpate.answer.fitted import Inverted
    from palpate.cli.sweep import executor_of
    from palpate.inversion.kept import Kept
    from palpate.inversion.recorded import felt_strokes
    from palpate.link.face import face_in_words
    from palpate.sim.probe.noise import level_named
    from palpate.sim.tissue.workers import pool

    if workers > 1 and scheduler is not None:
        raise UsageError("--workers is for this machine and --scheduler for a cluster; give one of them")
    level = level_named(noise)
    face = None if face_words is None else face_in_words(face_words)
    jobs: list[tuple[Path, Inverted | list[Any]]] = []
    joint: list[Any] = []
    for path, stroke, start in ((p, *pair) for p in recordings for pair in felt_strokes(p, face)):
        if isinstance(stroke, PalpateError):
            jobs.append((path, Inverted(start.stroke, problem=str(stroke))))
        elif together and not stroke.alone and joint:
            joint.append((stroke, start))
        else:
            job = [(stroke, start)]
            jobs.append((path, job))
            joint = joint if stroke.alone else job
    kept = {path: Kept(path) for path in recordings}
    for old in (one.path for one in kept.values() if one.outdated):
        note(f"{old} is of another version of the inversion: what it holds is fitted anew")
    before = [
        kept[path].find(job, level, kind) if isinstance(job, list) and not again else None
        for path, job in jobs
    ]
    if not all(before):
        announce()
    found: list[tuple[Path, Inverted]] = []
    with ExitStack() as stack:
        executor = stack.enter_context(executor_of(scheduler))
        if executor is None and workers > 1:
            executor = stack.enter_context(pool(workers, "palpate.inversion.strokes"))
        bar = stack.enter_context(progress("strokes"))
        task = bar.add_task("refining", total=len(jobs))
        work: list[Any] = [
            executor.submit(_inverted, job, level, kind)
            if executor and isinstance(job, list) and known is None
            else known or job
            for (_, job), known in zip(jobs, before)
        ]
        for (path, strokes), item in zip(jobs, work):
            if not isinstance(item, Inverted):
                item = _inverted(item, level, kind) if isinstance(item, list) else item.result()
                _keep(kept[path], strokes, level, kind, item)
            found.append((path, item))
            bar.advance(task)
            if not as_json:
                say("\n".join(lines_of(item, path if len(recordings) > 1 else None)))
    files = [one.path for one in kept.values() if one.path.exists()]
    if as_json:
        print_json({"strokes": [{"recording": path, **one.as_dict()} for path, one in found], "kept": files})
    elif files:
        taken = f"; {count} of them from before" if (count := sum(map(bool, before))) else ""
        say(f"kept in {', '.join(map(str, files))}{taken}")
    if report is not None:
        from palpate.report.refined_figures import write_refined

        page = write_refined(report, {path: [one for of, one in found if of == path] for path in recordings})
        note(f"wrote {page}")
    if all(one.problem for _, one in found):
        raise PalpateError(f"no stroke could be refined: {found[0][1].problem}")
    for _, one in found:
        if one.problem and as_json:
            note(one.problem)


def _keep(kept: Kept, job: Any, level: Noise, kind: str, answer: Inverted) -> None:
    """Keep an answer; where that fails the answer is shown all the same."""
    try:
        kept.keep(job, level, kind, answer)
    except PalpateError as error:
        note(f"not kept: {error}")


def _inverted(job: list[Any], level: Noise, kind: str) -> Inverted:
    """One press, or strokes over one lump."""
    from palpate.inversion.strokes import invert_stroke, invert_together

    return (
        invert_together(job, level, kind)
        if len(job) > 1
        else invert_stroke(job[0][0], job[0][1], level, kind)
    )


def lines_of(one: Inverted, path: Path | None = None) -> list[str]:
    """One stroke in words."""
    what = f"{'press' if one.press else 'stroke'} {one.stroke}"
    head = what if path is None else f"{path}, {what}"
    if one.together > 1:
        head = f"{one.together} strokes together"
    if one.problem:
        return [f"{head}: not refined: {one.problem}"]
    fit = "fits" if one.fits else f"DOES NOT FIT: {one.why}; worst in {one.worst}"
    rest = "" if one.settled else "; the search had not come to rest"
    lines = [f"{head}: {_KIND[one.kind]}; {fit} (misfit {one.chi2:.2f}{rest})"]
    for name, words, unit, digits in _SHOWN:
        if (value := one.values.get(name)) is not None:
            vague = "; hardly told" if _vague(value) else ""
            lines.append(f"  {words:<22}{_span(value, digits)} {unit}".rstrip() + vague)
    if one.lump:
        lines.append(f"  {'hard or soft':<22}{one.hardness}")
    if one.layers:
        lines.append(f"  {'layer':<22}{_odds(one.layers)}")
    return [*lines, f"  {'classes':<22}{_odds(one.classes)}"]


def _odds(shares: dict[str, float]) -> str:
    return ", ".join(f"{name} {share:.0%}" for name, share in shares.items())


_KIND = {
    "anywhere": "a lump",
    "border": "a lump on the border of fat and gland",
    "ball": "a ball",
    "ellipsoid": "an ellipsoid",
    "two lumps": "two lumps",
    "none": "no lump",
}
_WIDE = 4.0
_SHOWN = (
    ("d_mm", "diameter", "mm", 1),
    ("width_mm", "width across", "mm", 1),
    ("depth_mm", "tissue over it", "mm", 1),
    ("d2_mm", "diameter of second", "mm", 1),
    ("depth2_mm", "tissue over second", "mm", 1),
    ("apart_mm", "middles apart", "mm", 1),
    ("E_ratio", "stiffness over fat", "", 1),
    ("t_mm", "fat", "mm", 1),
    ("E_fat_kPa", "fat's modulus", "kPa", 1),
)


def _vague(value: Value) -> bool:
    """Whether an interval is so wide that its number says next to nothing."""
    return value.low is None or value.high is None or value.high > _WIDE * max(value.low, 1e-9)


def _span(value: Value, digits: int) -> str:
    low, high = (("?" if v is None else f"{v:.{digits}f}") for v in (value.low, value.high))
    return f"{value.value:.{digits}f}  ({low} to {high})"

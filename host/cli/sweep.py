"""`palpate sweep`: many finite-element strokes, resumable."""

from __future__ import annotations

import time
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate.cli.numbers import Finite
from palpate.console import json_option, note, print_json, progress, say
from palpate.errors import LinkError, MissingExtra, PalpateError, UsageError
from palpate.files import whole_file
from palpate.first_time import announce

if TYPE_CHECKING:
    from collections.abc import Iterator

    from palpate.sim.tissue import Progress


@click.command("sweep")
@click.option(
    "--design",
    required=True,
    help="thesis | one-factor | sobol:N[:SEED] | balls[:N[:SEED]] | balls-soft:N[:SEED] | "
    "balls-deep:N[:SEED] | balls-rim:N[:SEED] | any:N[:SEED] | any-press:N[:SEED] | anywhere:N[:SEED] | "
    "anywhere-press:N[:SEED] | a file with one code per line; several joined by +.",
)
@click.option(
    "--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="Directory of the strokes."
)
@click.option("--workers", type=click.IntRange(1), help="Processes on this machine; all cores by default.")
@click.option("--scheduler", help="A Dask cluster instead: its address, as tcp://10.0.0.5:8786.")
@click.option("--hx", "hx_mm", type=Finite(), default=2.0, show_default=True, help="Element width, mm.")
@click.option(
    "--keep",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Also keep the strokes over balls and ellipsoids as one compact .parquet file, with their recipe.",
)
@json_option
def command(
    design: str,
    out: Path,
    workers: int | None,
    scheduler: str | None,
    hx_mm: float,
    keep: Path | None,
    as_json: bool,
) -> None:
    """Simulate the strokes of a design; a sweep that was stopped goes on where it was.

    \b
    Designs:
      thesis           the thesis' thirty runs
      one-factor       one input varied at a time, finely
      sobol:N[:SEED]   N cases that fill the space of d, h, E, F evenly
      any:N[:SEED]     N lumps in random tissue, at three forces each
      any-press:N[:SEED]  the press before each of these strokes, at four forces
      anywhere:N[:SEED]  N lumps in the fat, on its border or in the gland, in random tissue, at three forces
      anywhere-press:N[:SEED]  the press before each of these
      balls:N[:SEED]   N balls and ellipsoids in random tissue, at three forces each (seconds a stroke)
      balls-soft:N[:SEED]  N of them over a gland less than twice as stiff as the fat
      balls-deep:N[:SEED]  N small ones that lie deep
      balls-rim:N[:SEED]  N of them outside the sizes and stiffnesses that a model is for
      FILE             one case code per line

    \b
    Example:
      palpate sweep --design thesis --out out/thesis
      palpate sweep --design sobol:64:1 --out out/field --workers 2
      palpate sweep --design balls:100 --out out/balls --keep balls.parquet
    """
    from palpate.sim.tissue import read_design, sweep
    from palpate.sim.tissue.design import settings_of

    if workers is not None and scheduler is not None:
        raise UsageError("--workers is for this machine and --scheduler for a cluster; give one of them")
    cases = read_design(design)
    settings = settings_of(design, hx_mm)
    if keep is not None and (keep.suffix != ".parquet" or not any(case.solid for case in cases)):
        raise UsageError("--keep writes balls and ellipsoids into a file named .parquet")
    announce()
    began = time.monotonic()
    last: list[Progress] = []
    with executor_of(scheduler) as executor, progress("strokes") as bar:
        task = bar.add_task("simulating", total=len(cases))

        def show(now: Progress) -> None:
            last[:] = [now]
            bar.update(task, completed=now.done, total=now.total)

        result = sweep(cases, settings, out, executor=executor, workers=workers, progress=show)
    failed = result[result.status != "ok"]
    failures = {str(row.code): str(row.reason) for row in failed.itertuples()}
    seconds = time.monotonic() - began
    if keep is not None:
        from palpate.sim.tissue.solid.kept import keep as keep_strokes

        with whole_file(keep) as path:
            note(f"kept {keep_strokes(out, path, design, settings)} strokes in {keep}")
    reused = last[0].reused if last else 0
    summary = {
        "design": design,
        "out": str(out),
        "strokes": len(result),
        "reused": reused,
        "failed": failures,
        "seconds": seconds,
    }
    if as_json:
        print_json(summary)
    else:
        say(f"{len(result)} strokes in {out} ({reused} were there already), {seconds:.1f} s")
    for code, reason in list(failures.items())[:10]:
        note(f"  {code}: {reason}")
    if len(failed) == len(result):
        raise PalpateError(f"none of the {len(result)} strokes could be computed; the first says why")
    if len(failed):
        note(
            f"{len(failed)} strokes could not be computed; they are marked in the table and left out of fits"
        )


@contextmanager
def executor_of(scheduler: str | None) -> Iterator[Executor | None]:
    """The cluster's executor, or None for processes of our own."""
    if scheduler is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtra("distributed", "cluster", "a Dask scheduler") from None
    try:
        client = Client(scheduler, timeout=30)
    except (OSError, ValueError, TimeoutError) as error:
        message = (
            f"no Dask scheduler answers at {scheduler}; start one with `dask scheduler` and check the address"
        )
        raise LinkError(message) from error
    with client:
        yield client.get_executor()

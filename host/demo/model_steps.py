"""The demo's first half: strokes, a model, its signed image."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from palpate.console import progress, table
from palpate.demo.lump import NOISE, say
from palpate.errors import PalpateError
from palpate.files import whole_file
from palpate.first_time import announce


def sweep_step(directory: Path) -> list[Any]:
    """Simulate the thesis' runs that `directory` does not hold yet."""
    from palpate.learn.thesis.runs import read_strokes
    from palpate.sim.tissue import Progress, Settings, read_design, sweep

    announce(firmware=True)
    cases = read_design("thesis")
    reused = 0
    with progress("strokes") as bar:
        task = bar.add_task("   simulating", total=len(cases))

        def show(now: Progress) -> None:
            nonlocal reused
            reused = now.reused
            bar.update(task, completed=now.done, total=now.total)

        done = sweep(cases, Settings(), directory, progress=show)
    failed = done[done.status != "ok"]
    if len(failed):
        raise PalpateError(
            f"{len(failed)} strokes failed, the first is {failed.iloc[0].code}: {failed.iloc[0].reason}"
        )
    say(f"{len(done)} strokes in {directory}, {reused} of them from an earlier run")
    return read_strokes(directory)


def fit_step(strokes: list[Any], path: Path, stderr: bool) -> Any:
    """Fit the thesis' model to the strokes and write it to `path`."""
    from palpate.learn.thesis.fit import fit_thesis
    from palpate.learn.thesis.polynomial import fit_thesis_model
    from palpate.learn.thesis.runs import features_table
    from palpate.sim.tissue.one_thread import one_blas_thread

    with one_blas_thread():
        fit = fit_thesis(features_table(strokes), permutations=0)
        _print_table_1(fit, stderr)
        spec = fit_thesis_model(strokes, noise=NOISE)
    spec.save(path)
    return fit


def _print_table_1(fit: Any, stderr: bool) -> None:
    """Table 1, narrow enough for any terminal; `palpate fit` prints all of it."""
    rows = []
    for pressure, both in zip(fit.entries[::2], fit.entries[1::2]):
        numbers = []
        for entry in (pressure, both):
            numbers += [entry.thesis_r2, entry.direct.r2_in, entry.direct.r2_loo]
        rows.append(
            (pressure.row.name, *("-" if x is None else f"{x:.3f}" for x in numbers), str(pressure.n))
        )
    heads = ("R2", *("thesis", "ours", "left out") * 2, "n")
    table(heads, rows, "   Table 1: from pressure alone (left), with displacement (right)", stderr)
    say("left out: leave-one-out with the terms chosen again each time")


def export_step(spec: Any, key: Path, path: Path) -> bytes:
    """Compile and sign the model; the image, which is also written to `path`."""
    from palpate.model_export.errors import SigningError
    from palpate.model_export.exporter import export
    from palpate.model_export.signing import keys

    try:
        image, report = export(spec, key, force=True)
    except SigningError:  # none yet, or one of the old kind
        shutil.rmtree(key, ignore_errors=True)
        keys.generate(key)
        image, report = export(spec, key, force=True)
    with whole_file(path) as part:
        part.write_bytes(image)
    for line in report.lines():
        say(line)
    return image

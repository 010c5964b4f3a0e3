"""The demo's steps, in their order. Every number that it prints was computed a moment before."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate import models
from palpate.console import console, progress
from palpate.demo.lump import LUMP, NOISE, STROKES, say
from palpate.demo.model_steps import export_step, fit_step, sweep_step
from palpate.demo.probe_steps import emulate_step, flash_step, replay_step, stroke_step
from palpate.demo.result import DemoResult, say_result, summary, truth, verdict
from palpate.errors import PalpateError
from palpate.files import whole_file
from palpate.sim.probe.node import check_runtime
from palpate.wire.events import Estimate, Frame, TactileMap

if TYPE_CHECKING:
    from palpate.answer.told import AcrossStroke

EXPERIENCE = "the thesis' thirty strokes"


class _Steps:
    """Numbered headings, and how long each step took."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, name: str, words: str) -> Iterator[None]:
        console(stderr=True).print(f"\n[bold]{len(self.seconds) + 1}. {name}[/bold]  {words}")
        began = time.monotonic()
        yield
        self.seconds[name] = time.monotonic() - began


def run(out: Path, runtime: str = "micropython", fresh: bool = False, stderr: bool = False) -> DemoResult:
    """Run the whole chain into the directory `out`.

    Parameters
    ----------
    out : Path
        Strokes, model, key, image, recording and picture go here; strokes that are there are reused.
    runtime : str
        What carries the emulated probe's firmware: micropython or cpython.
    fresh : bool
        Compute the strokes again.
    stderr : bool
        Print the results, too, on standard error: standard output is for JSON.

    Raises
    ------
    PalpateError
        A step failed, or the host's replay of the recording differs from what the probe sent.
    """
    check_runtime(runtime)
    out.mkdir(parents=True, exist_ok=True)
    step = _Steps()
    files = {
        "strokes": out / "strokes",
        "model": out / "model.json",
        "image": out / "model.palp",
        "recording": out / "stroke.mcap",
        "picture": out / "demo.png",
        "narrow": out / "demo-narrow.png",
        "report": out / "report" / "index.html",
    }
    if fresh:
        shutil.rmtree(files["strokes"], ignore_errors=True)
    with step("Sweep", f"{EXPERIENCE}, contact finite elements"):
        strokes = sweep_step(files["strokes"])
    with step("Fit", "tactile maps, features, inverse regression"):
        thesis = fit_step(strokes, files["model"], stderr)
    with step("Export", "the model of balls that comes with Palpate, signed for the integer evaluator"):
        image = export_step(models.load(models.BALLS), out / "key", files["image"])
    with ExitStack() as stack:
        with step("Probe", f"{runtime} on a pseudo-terminal, {LUMP} under its sensors"):
            probe = stack.enter_context(emulate_step(runtime, out))
            say(f"{probe.port}, {NOISE} sensors in a hand whose force wanders")
        with step("Flash", "the model image over the serial line"):
            model_id = flash_step(probe.port, image)
        with step("Stroke", f"{STROKES} strokes: frames, displacement, and the probe's own estimates"):
            frames, found, estimate = stroke_step(probe.port, files["recording"])
            identical, across, together = replay_step(files["recording"])
            true = truth()
            _pictures(files, frames, found, estimate, across, true)
    with step("Report", "these strokes, and the thesis' figures and tables from the thirty"):
        _report(strokes, thesis, files["report"], summary(estimate, across, together, true, files))
    say_result(estimate, across, together, true, identical, files, stderr)
    if not identical:
        raise PalpateError("the host's replay of the stroke differs from what the probe sent")
    return DemoResult(
        estimate.as_dict(),
        None if across is None else across.as_dict(),
        None if together is None else together.as_dict(),
        true,
        identical,
        model_id,
        len(image),
        files,
        step.seconds,
    )


def _report(strokes: list[Any], thesis: Any, page: Path, told: Any) -> None:
    """Write the report, unless the one that is there was made from the same strokes and says the same."""
    from palpate.learn.probe_model import training_hash
    from palpate.report import write_report

    numbers = thesis.table.select_dtypes("number").to_numpy(dtype=float)
    made_from, stamp = f"{training_hash(numbers)} {told.rows}", page.with_name("made-from")
    if page.exists() and stamp.exists() and stamp.read_text() == made_from:
        say(f"{page}, from an earlier run")
        return
    with progress("figures and tables") as bar:
        task = bar.add_task("   drawing", total=None)
        write_report(
            page.parent, strokes=strokes, thesis=thesis, summary=told, progress=lambda name: bar.advance(task)
        )
    stamp.write_text(made_from)


def _pictures(
    files: dict[str, Path],
    frames: list[Frame],
    found: TactileMap,
    estimate: Estimate,
    across: AcrossStroke | None,
    truth: dict[str, float],
) -> None:
    """For a desk with the verdict as its headline; for a phone, whose report has it as its own."""
    from palpate.demo.picture import draw

    said = ({} if across is None else across.as_dict()) | estimate.as_dict()
    with whole_file(files["picture"]) as part:
        draw(part, frames, found, said, truth, verdict(estimate, truth))
    with whole_file(files["narrow"]) as part:
        draw(part, frames, found, said, truth, narrow=True)

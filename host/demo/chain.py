"""The demo's six steps. Every number that it prints was worked out a moment before."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from host.cli.output import console, note, progress, table
from host.cli.stream import counts_line
from host.errors import PalpateError
from host.files import whole_file
from host.link.events import Estimate, Frame, TactileMap

LUMP = "d12h07e20f09"
"""The lump under the emulated probe: not one of the thesis' thirty."""

NOISE, SEED = "typical", 20
EXPERIENCE = "the thesis' thirty strokes"


@dataclass(frozen=True)
class DemoResult:
    """What the demo found.

    Parameters
    ----------
    estimate : dict
        The probe's own estimate, in its JSON form.
    truth : dict
        The case's inputs under the estimate's names.
    replay_identical : bool
        True where the host's replay of the recording gave the same integers.
    model_id : str
        Read back from the probe after flashing.
    image_bytes : int
        Size of the signed model image.
    files : dict of str to Path
        strokes, model, image, recording, picture, report.
    seconds : dict of str to float
        Wall time of each step.
    """

    estimate: dict[str, Any]
    truth: dict[str, float]
    replay_identical: bool
    model_id: str
    image_bytes: int
    files: dict[str, Path]
    seconds: dict[str, float]


def say(text: str) -> None:
    """A line under the step's heading."""
    note(f"   {text}")


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
        Strokes, model, key, image, recording and picture go here; strokes that are there are re-used.
    runtime : str
        What carries the emulated probe's firmware: micropython or cpython.
    fresh : bool
        Compute the strokes anew.
    stderr : bool
        Print the results, too, on standard error: standard output is for JSON.

    Raises
    ------
    PalpateError
        A step failed, or the host's replay of the recording differs from what the probe said.
    """
    out.mkdir(parents=True, exist_ok=True)
    step = _Steps()
    files = {
        "strokes": out / "strokes",
        "model": out / "model.json",
        "image": out / "model.palp",
        "recording": out / "stroke.mcap",
        "picture": out / "demo.png",
        "report": out / "report" / "index.html",
    }
    if fresh:
        shutil.rmtree(files["strokes"], ignore_errors=True)
    with step("Sweep", f"{EXPERIENCE}, contact finite elements"):
        strokes = _sweep(files["strokes"])
    with step("Fit", "tactile maps, features, inverse regression"):
        thesis, spec = _fit(strokes, files["model"], stderr)
    with step("Export", "coefficients to a signed image for the integer evaluator"):
        image = _export(spec, out / "key", files["image"])
    with ExitStack() as stack:
        with step("Probe", f"{runtime} on a pseudo-terminal, {LUMP} under its sensors"):
            probe = stack.enter_context(_emulate(runtime, out))
            say(f"{probe.port}, {NOISE} sensors in a steady hand")
        with step("Flash", "the model image over the serial line"):
            model_id = _flash(probe.port, image)
        with step("Stroke", "frames, displacement, and the probe's own estimate"):
            frames, found, estimate = _stroke(probe.port, files["recording"])
            identical = _replay(files["recording"])
            truth = _truth()
            _picture(files["picture"], frames, found, estimate, truth)
    with step("Report", "the thesis' figures and tables, made from these strokes"):
        _report(strokes, thesis, files["report"])
    _say_result(estimate, truth, identical, files, stderr)
    if not identical:
        raise PalpateError("the host's replay of the stroke differs from what the probe said")
    return DemoResult(estimate.as_dict(), truth, identical, model_id, len(image), files, step.seconds)


def _sweep(directory: Path) -> list[Any]:
    from host.regression.runs import read_strokes
    from sim.tissue import Progress, Settings, read_design, sweep

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


def _fit(strokes: list[Any], path: Path, stderr: bool) -> tuple[Any, Any]:
    from host.regression.runs import features_table
    from host.regression.thesis import fit_thesis
    from host.regression.thesis_model import fit_thesis_model

    fit = fit_thesis(features_table(strokes), permutations=0)
    _print_table_1(fit, stderr)
    spec = fit_thesis_model(strokes, noise=NOISE)
    spec.save(path)
    return fit, spec


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
    say("left out: leave-one-out with the terms chosen anew each time")


def _export(spec: Any, key: Path, path: Path) -> bytes:
    from model_export import keys
    from model_export.errors import SigningError
    from model_export.exporter import export

    try:
        image, report = export(spec, key)
    except SigningError:  # none yet, or its 32 signatures are given
        shutil.rmtree(key, ignore_errors=True)
        keys.generate(key, 5)
        image, report = export(spec, key)
    with whole_file(path) as part:
        part.write_bytes(image)
    for line in report.lines():
        say(line)
    return image


def _emulate(runtime: str, out: Path) -> Any:
    from sim.probe.emulated import EmulatedProbe
    from sim.probe.sensors import LEVELS, StrokeField, stroke_frames
    from sim.tissue import Case, Settings, simulate

    field = StrokeField(simulate(Case.from_code(LUMP), Settings(far_start_mm=-44.0)))
    strokes = [stroke_frames(field, LEVELS[NOISE].without("force"), SEED)]
    store = out / "probe"
    shutil.rmtree(store, ignore_errors=True)  # a probe fresh from the factory
    public_key = (out / "key" / "public.key").read_bytes()
    return EmulatedProbe(runtime, strokes, store=store, public_key=public_key, roomy=True)


def _flash(port: str, image: bytes) -> str:
    from host.link.flash import flash
    from host.link.probe import Probe

    with Probe.open(port) as probe, progress("bytes") as bar:
        task = bar.add_task("   flashing", total=len(image))
        done = flash(probe, image, lambda at, size: bar.update(task, completed=at, total=size))
        model_id = probe.refresh_identity().model_id
    if model_id != done.model_id:
        raise PalpateError(f"the probe names model {model_id} and not {done.model_id}, which was flashed")
    say(f"{done.size} bytes; signature verified, self-test passed; the probe names model {model_id}")
    return model_id


def _stroke(port: str, recording: Path) -> tuple[list[Frame], TactileMap, Estimate]:
    from host.record.session import both_counts, recorded

    frames: list[Frame] = []
    found: TactileMap | None = None
    estimate: Estimate | None = None
    with recorded(port, recording, overwrite=True) as probe:
        for event in probe.stream(strokes=1, timeout_s=60):
            if isinstance(event, Frame):
                frames.append(event)
            elif isinstance(event, TactileMap):
                found = event
            elif isinstance(event, Estimate):
                estimate = event
        say(counts_line(both_counts(probe)))
    if estimate is None or found is None:
        raise PalpateError("the stroke ended without an estimate; run the demo again with PALPATE_DEBUG=1")
    return frames, found, estimate


def _replay(recording: Path) -> bool:
    from host.record.replay import replay

    strokes = list(replay(recording))
    return bool(strokes) and all(stroke.identical for stroke in strokes)


def _report(strokes: list[Any], thesis: Any, page: Path) -> None:
    """Write the report, unless the one that is there was made from the same strokes."""
    from host.regression.probe_model import training_hash
    from host.report import write_report

    numbers = thesis.table.select_dtypes("number").to_numpy(dtype=float)
    made_from, stamp = training_hash(numbers), page.with_name("made-from")
    if page.exists() and stamp.exists() and stamp.read_text() == made_from:
        say(f"{page}, from an earlier run")
        return
    with progress("figures and tables") as bar:
        task = bar.add_task("   drawing", total=None)
        write_report(page.parent, strokes=strokes, thesis=thesis, progress=lambda name: bar.advance(task))
    stamp.write_text(made_from)


def _truth() -> dict[str, float]:
    from sim.tissue import Case

    case = Case.from_code(LUMP)
    return {
        "F_N_per_m": case.F_N_per_m,
        "t_mm": case.t_mm,
        "d_mm": case.d_mm,
        "h": case.h,
        "E_inv23": case.E_ratio ** (-2 / 3),
        "E_ratio": case.E_ratio,
    }


def _picture(
    path: Path, frames: list[Frame], found: TactileMap, estimate: Estimate, truth: dict[str, float]
) -> None:
    from host.demo.picture import draw

    with whole_file(path) as part:
        draw(part, frames, found, estimate.as_dict(), truth)


def _say_result(
    estimate: Estimate,
    truth: dict[str, float],
    identical: bool,
    files: dict[str, Path],
    stderr: bool,
) -> None:
    names = {
        "d_mm": "diameter d, mm",
        "h": "depth h, diameters",
        "t_mm": "fat thickness t, mm",
        "E_inv23": "stiffness E^(-2/3)",
        "F_N_per_m": "force F, N/m",
    }
    level = estimate.level_permille / 10
    rows = []
    for name, words in names.items():
        got = estimate.outputs[name]
        rows.append(
            (words, f"{got['value']:.3g}", f"{got['low']:.3g} to {got['high']:.3g}", f"{truth[name]:.3g}")
        )
    table(("", "the probe says", f"{level:g} % interval", "truth"), rows, stderr=stderr)
    click.echo(
        f"   lump: {'yes' if estimate.lump else 'no'}; hard or soft: {estimate.hardness} "
        f"(truth: E = {truth['E_ratio']:g}); "
        f"{'inside' if estimate.in_domain else 'outside'} the model's domain",
        err=stderr,
    )
    click.echo(f"   replay: {'identical' if identical else 'DIFFERENT'}", err=stderr)
    for name in ("picture", "recording", "report"):
        click.echo(f"   {name}: {files[name]}", err=stderr)

"""`palpate stream`: strokes from a probe, recorded."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from palpate.cli.numbers import Finite
from palpate.cli.ports import (
    NOMINAL_SCALE,
    document_option,
    estimate_dict,
    estimate_lines,
    fat_option,
    port_option,
    tell_damage,
    visit_lines,
)
from palpate.cli.real import load_model
from palpate.console import json_option, note, plain, print_json, printable, say
from palpate.errors import CommandTimeout, LinkError, UsageError

if TYPE_CHECKING:
    from palpate.answer.told import Told
    from palpate.inversion import Inverted
    from palpate.link.lsl import Outlets
    from palpate.link.probe import Probe
    from palpate.link.rerun_log import RerunLog
    from palpate.stroke.follower import Follower
    from palpate.wire.events import Estimate, Event, Log

WARNINGS = {
    "force_low": "press harder: the force is below the range",
    "force_high": "press less: the force is above the range",
    "too_fast": "stroke more slowly",
}


LOGS_A_SECOND = 10
"""A probe's log lines that are shown; all of them are recorded."""


class ShownLogs:
    """Which of a probe's log lines are shown: no more than `LOGS_A_SECOND` by the time at which they came."""

    def __init__(self) -> None:
        self._second = self._shown = self._left_out = 0

    def lines(self, log: Log) -> list[str]:
        """What to print of it: its text, escaped; before it how many were left out."""
        lines = []
        if (second := log.host_ns // 1_000_000_000) != self._second:
            if self._left_out:
                lines.append(f"  probe: {self._left_out} more lines, not shown")
            self._second, self._shown, self._left_out = second, 0, 0
        if self._shown >= LOGS_A_SECOND:
            self._left_out += 1
        else:
            self._shown += 1
            lines.append(f"  probe: {printable(log.text)}")
        return lines


@click.command("stream")
@port_option
@click.option("--strokes", type=click.IntRange(0), default=0, help="Stop after so many; 0: until Ctrl-C.")
@click.option("--seconds", type=Finite(0.0, 1e6, min_open=True), help="Stop after so long.")
@click.option(
    "--record", type=click.Path(path_type=Path, dir_okay=False), help="Record the session: FILE.mcap."
)
@click.option("--overwrite", is_flag=True, help="Replace an existing recording (--record, --rerun).")
@click.option("--every", type=click.IntRange(1, 255), default=1, help="Send each n-th frame only.")
@click.option("--timeout", "timeout_s", type=Finite(0.0, 1e6, min_open=True), default=60.0, show_default=True,
              help="Give up after so many of the probe's seconds without a sign of it.")  # fmt: skip
@document_option
@fat_option
@click.option("--refine", is_flag=True, help="Fit the finite-element model to each stroke, too, meanwhile.")
@click.option("--lsl", is_flag=True, help="Hand everything on to LabStreamingLayer.")
@click.option("--rerun", metavar="FILE.rrd|spawn", help="Show it in rerun, or write a file for it.")
@click.option("--earlier", is_flag=True, help="First fetch the estimates that an earlier client left behind.")
@click.option("--json-lines", is_flag=True, help="Print each estimate as a line of JSON as it comes.")
@json_option
def command(
    port: str,
    baud: int,
    strokes: int,
    seconds: float | None,
    record: Path | None,
    overwrite: bool,
    every: int,
    timeout_s: float,
    earlier: bool,
    document: Path | None,
    fat_kPa: float | None,
    refine: bool,
    lsl: bool,
    rerun: str | None,
    json_lines: bool,
    as_json: bool,
) -> None:
    """Stream strokes from a probe: its estimates, its warnings, and what the link lost.

    Ctrl-C ends it; the recording is whole then, too. After an unplug it waits for the probe and goes on.

    \b
    Example:
      palpate stream --strokes 1
      palpate stream --strokes 3 --record visit.mcap --refine
      palpate stream --port socket://localhost:7624 --strokes 1 --json
    """
    from palpate.answer.visit import visit_answer
    from palpate.link.session import both_counts, counts_line, recorded
    from palpate.stroke.documents import Documents
    from palpate.stroke.follower import Follower
    from palpate.wire.events import Estimate, Gap

    if as_json and json_lines:
        raise UsageError("--json prints one document, --json-lines one for each estimate; give one of them")
    if refine:
        from palpate.cli.refining import refining
        from palpate.first_time import announce

        announce()
    follower = Follower(Documents(None if document is None else load_model(document)))
    quiet = as_json or json_lines
    estimates: list[dict[str, Any]] = []
    answers: list[tuple[Estimate, Told | None]] = []
    logs = ShownLogs()
    counts: dict[str, int] = {}
    refined: list[dict[str, Any]] = []
    shown = None if rerun is None else _rerun(rerun, overwrite, fat_kPa)
    with refining(port, record) if refine else nullcontext() as refiner:
        with ExitStack() as stack:
            probe = stack.enter_context(recorded(port, record, overwrite, baud))
            if shown is not None:
                stack.enter_context(shown)
            if not quiet:
                _greet(probe)
            clock_dict(probe)
            remark = _meet(follower, probe, document, "")
            outlets = _outlets(probe) if lsl else None
            before = _left_behind(probe, follower, quiet, fat_kPa) if earlier else []
            interrupted = scale_told = False
            serial = probe.identity.serial
            until = time.monotonic() + (seconds or 0.0)
            try:
                for event in probe.stream(strokes, every, timeout_s):
                    if not scale_told and not quiet:
                        _say_scale(probe)
                    scale_told = True
                    follower.take(event)
                    if isinstance(event, Gap) and event.ended:
                        remark = _meet(follower, probe, document, remark)  # it may be another
                    told = follower.of(event) if isinstance(event, Estimate) else None
                    if isinstance(event, Estimate):
                        answers.append((event, told))
                    _show(event, told, estimates, logs, quiet, json_lines, fat_kPa)
                    if not quiet and probe.identity.serial != serial:
                        serial = probe.identity.serial
                        note(f"  it is another one: probe {serial}")
                    for outlet in (outlets, shown):
                        if outlet is not None:
                            outlet.push(event, told)
                    if refiner is not None:
                        refiner.take(event, follower.calibration)
                        refined += _refined(refiner.done(), quiet, json_lines)
                    probe.check_recording()
                    if seconds is not None and time.monotonic() > until:
                        break
            except KeyboardInterrupt:
                interrupted = True
            finally:
                counts.update(both_counts(probe))
                if not quiet:
                    note(counts_line(counts))
            together = visit_answer(answers)
            summary = {
                "port": probe.name,
                "probe": probe.identity.as_dict(),
                "strokes": estimates,
                "together": None if together is None else together.as_dict(),
                "earlier": before,
                "link": counts,
                "clock": clock_dict(probe),
            }
        if refiner is not None and not interrupted:
            if refiner.waiting and not quiet:
                note(f"refining {refiner.waiting} more; Ctrl-C leaves them")
            refined += _refined(refiner.rest(), quiet, json_lines)
    if not quiet and together is not None:
        say("\n".join(visit_lines(together, fat_kPa)))
    if record is not None and not quiet:
        note(f"recorded {record}")
    for line in [] if refiner is None else refiner.kept():
        note(line)
    if as_json:
        print_json({**summary, "refined": refined, "recording": record})
    if interrupted:
        raise KeyboardInterrupt
    if strokes and seconds is None and len(estimates) < strokes:
        raise CommandTimeout(
            f"no sign of the probe for {timeout_s:g} s, {len(estimates)} of {strokes} strokes came; "
            "check the probe, or give a longer --timeout"
        )


def _meet(follower: Follower, probe: Probe, document: Path | None, before: str) -> str:
    """Ask the probe for its model; says what is to be said of the document, unless it was said before."""
    with suppress(LinkError):  # gone at this moment: it is met when it is back
        follower.meet(probe)
    if (remark := follower.documents.remark) and remark != before:
        note(f"{document} {remark}")
    return remark


def _outlets(probe: Probe) -> Outlets:
    from palpate.link.lsl import ESTIMATES, EVENTS, FRAMES, Outlets

    outlets = Outlets(probe)
    note(f"on LabStreamingLayer as {FRAMES}, {ESTIMATES} and {EVENTS}")
    return outlets


def _rerun(where: str, overwrite: bool, fat_kPa: float | None) -> RerunLog:
    from palpate.link.rerun_log import RerunLog

    return RerunLog(where, overwrite, lambda estimate, told: estimate_lines(estimate, fat_kPa, told))


def _left_behind(
    probe: Probe, follower: Follower, quiet: bool, fat_kPa: float | None
) -> list[dict[str, Any]]:
    """Estimates of strokes that another client's stream made and nobody took: shown apart from this one's.

    What follows from features is added; for a place it would take the frames, which have gone.
    """
    from palpate.wire.events import Estimate

    results = probe.earlier_results()
    for result in results:
        follower.take(result)
    found = [(event, follower.of(event)) for event in results if isinstance(event, Estimate)]
    for event, told in found:
        if not quiet:
            say(f"of an earlier stream ({event.stream}):")
            say("\n".join(estimate_lines(event, fat_kPa, told)))
    return [estimate_dict(event, fat_kPa, told) for event, told in found]


def clock_dict(probe: Probe) -> dict[str, float] | None:
    """Offset and drift of the probe's clock with their uncertainty; None if the probe is gone."""
    with suppress(LinkError):
        if probe.connected:
            probe.sync_clock()
    clock = probe.clock
    if clock is None:
        return None
    return {
        "offset_us": clock.offset_us,
        "drift_ppm": clock.drift_ppm,
        "uncertainty_us": clock.uncertainty_us,
        "exchanges": clock.exchanges,
    }


def _greet(probe: Probe) -> None:
    who = probe.identity
    model = "no model yet: `palpate flash` puts one on it" if "flash" in who.capabilities else "no model"
    model = f"model {who.model_id}" if who.has_model else model
    note(f"{probe.name}: probe {who.serial}, firmware {who.firmware}, {model}")
    tell_damage(probe)


def _say_scale(probe: Probe) -> None:
    if not probe.scale.calibrated:
        note(f"the probe reports no calibration: {NOMINAL_SCALE}")


def _show(
    event: Event,
    told: Told | None,
    estimates: list[dict[str, Any]],
    logs: ShownLogs,
    quiet: bool,
    json_lines: bool,
    fat_kPa: float | None,
) -> None:
    from palpate.wire.events import Estimate, Gap, Log, StrokeState

    if isinstance(event, Estimate):
        estimates.append(estimate_dict(event, fat_kPa, told))
        if json_lines:
            _print_line(estimates[-1])
        elif not quiet:
            say("\n".join(estimate_lines(event, fat_kPa, told)))
    elif quiet:
        return
    elif isinstance(event, StrokeState) and event.state in WARNINGS:
        note(f"  {WARNINGS[event.state]}")
    elif isinstance(event, Gap):
        note(f"  {'the probe is back' if event.ended else event.reason}")
    elif isinstance(event, Log):
        for line in logs.lines(event):
            note(line)


def _print_line(found: dict[str, Any]) -> None:
    """As `--json-lines` prints it, at once."""
    sys.stdout.write(json.dumps(plain(found)) + "\n")
    sys.stdout.flush()


def _refined(found: Iterator[Inverted], quiet: bool, json_lines: bool) -> list[dict[str, Any]]:
    """Show what was found, and give it as `--json` prints it."""
    from palpate.cli.refine import lines_of

    out = []
    for one in found:
        out.append(one.as_dict())
        if json_lines:
            _print_line({"refined": out[-1]})
        elif not quiet:
            say("refined: " + "\n".join(lines_of(one)))
    return out

"""What the demo found: for programs, and as lines on the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.answer.visit import HOW
from palpate.answer.words import stiffness_words
from palpate.console import say, table
from palpate.demo.lump import LUMP, NOISE
from palpate.spans import Span, without_minus_zero
from palpate.wire.events import Estimate

if TYPE_CHECKING:
    from palpate.answer.told import AcrossStroke
    from palpate.answer.visit import VisitAnswer


@dataclass(frozen=True)
class DemoResult:
    """What the demo found.

    Parameters
    ----------
    estimate : dict
        The probe's own estimate of the first stroke, in its JSON form.
    across : dict or None
        Width and place across this stroke, which the host worked out, in their JSON form.
    together : dict or None
        The strokes pooled, in their JSON form; None where fewer than two can be relied on.
    truth : dict
        The case's inputs under the estimates' names.
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
    across: dict[str, Any] | None
    together: dict[str, Any] | None
    truth: dict[str, float]
    replay_identical: bool
    model_id: str
    image_bytes: int
    files: dict[str, Path]
    seconds: dict[str, float]


def truth() -> dict[str, float]:
    """What the simulated lump really is, by the outputs' names."""
    from palpate.sim.tissue import Case

    case = Case.from_code(LUMP)
    return {
        "F_N_per_m": case.F_N_per_m,
        "t_mm": case.t_mm,
        "d_mm": case.d_mm,
        "depth_mm": case.d_mm * case.h,
        "h": case.h,
        "E_inv23": case.E_ratio ** (-2 / 3),
        "E_ratio": case.E_ratio,
        "E_fat_kPa": case.fat_kPa,
        "width_mm": 2 * case.half_axes_mm[1],
        "place_mm": case.offset_mm,
    }


def summary(
    estimate: Estimate,
    across: AcrossStroke | None,
    together: VisitAnswer | None,
    true: dict[str, float],
    files: dict[str, Path],
) -> Any:
    """The report's first section: what the strokes say together, else what the first one says."""
    from palpate.report.items import Summary

    text = (
        f"Strokes of an emulated probe over a lump that no model has seen ({LUMP}), {NOISE} sensors in a "
        "hand whose force wanders. The probe works out each estimate by itself, in integers; the host's "
        "replay of the recording gives the same. The host adds what lies across the stroke."
    )
    picture, narrow, level = files["picture"], files["narrow"], _level(estimate)
    if together is None:
        rows = rows_of(estimate, across, true)
        return Summary(
            verdict(estimate, true), text, "One stroke", "the probe says", rows, picture, narrow, level
        )
    title, says = f"{together.strokes} strokes together", "the strokes say"
    return Summary(
        visit_verdict(together), text, title, says, visit_rows(together, true), picture, narrow, level, HOW
    )


def _level(estimate: Estimate) -> str:
    return f"{estimate.level_permille / 10:g} % interval"


def verdict(estimate: Estimate, true: dict[str, float]) -> str:
    """What was found, in a line; the demo knows its fat."""
    if not estimate.lump:
        return "No lump found"
    if not estimate.valid or (depth := estimate.depth_mm) is None:
        return f"No estimate: {estimate.reason}"
    factor = stiffness_words(estimate.span("E_inv23"), estimate.fat_kPa())
    stiff = "hard or soft cannot be told from one stroke"
    if estimate.hardness != "unsure":
        stiff = f"{estimate.hardness}: {factor}"
    caveat = "" if estimate.in_domain else " (outside what the model knows)"
    return _lump(estimate.span("d_mm"), depth, stiff) + caveat


def visit_verdict(together: VisitAnswer) -> str:
    """What the strokes found together, in a line."""
    stiff = f"{together.hardness}: {together.stiffness_words()}"
    if together.hardness == "unsure":
        stiff = f"hard or soft cannot be told from {together.strokes} strokes"
    return _lump(together.spans["d_mm"], together.spans["depth_mm"], stiff)


def _lump(size: Span, depth: Span, stiff: str) -> str:
    (d, low, high), (deep, top, bottom) = size, depth
    where = f"{deep:.1f} mm deep ({top:.1f} to {bottom:.1f})"
    return f"A lump of {d:.1f} mm ({low:.1f} to {high:.1f}), {where}, {stiff}"


def shown(name: str, span: Span) -> Span:
    """Value, low and high as they are shown: but for the place nothing can be below 0."""
    if name == "place_mm":
        return without_minus_zero(span)
    value, low, high = (max(x, 0.0) for x in span)
    return value, low, high


def rows_of(
    estimate: Estimate, across: AcrossStroke | None, true: dict[str, float]
) -> list[tuple[str, str, str, str]]:
    """Quantity, value, interval and truth of one stroke, as text."""
    spans = {name: estimate.span(name) for name in estimate.outputs}
    added = {"depth_mm": estimate.depth_mm}
    if across is not None:
        added |= {"width_mm": across.width_mm, "place_mm": across.place_mm}
    spans |= {name: span for name, span in added.items() if span is not None}
    factor = stiffness_words(spans["E_inv23"], spans.get("E_fat_kPa")) if "E_inv23" in spans else ""
    return _rows(spans, estimate.hardness, factor, true)


def visit_rows(together: VisitAnswer, true: dict[str, float]) -> list[tuple[str, str, str, str]]:
    """The same of the strokes together: force and place are each stroke's own, and not among them."""
    return _rows(together.spans, together.hardness, together.stiffness_words(), true)


def _rows(
    spans: Mapping[str, Span], hardness: str, factor: str, true: dict[str, float]
) -> list[tuple[str, str, str, str]]:
    names = {
        "d_mm": "diameter d, mm",
        "depth_mm": "depth, mm",
        "h": "depth h, diameters",
        "t_mm": "fat thickness t, mm",
        "E_inv23": "stiffness E^(-2/3)",
        "E_fat_kPa": "stiffness of the fat, kPa",
        "F_N_per_m": "force F, N/m",
        "width_mm": "width across, mm (host)",
        "place_mm": "place across, mm (host)",
    }
    rows = []
    for name, words in names.items():
        if name in spans:
            value, low, high = shown(name, spans[name])
            rows.append((words, f"{value:.3g}", f"{low:.3g} to {high:.3g}", f"{true[name]:.3g}"))
    if factor:
        really = f"{true['E_ratio']:g} × fat, {true['E_ratio'] * true['E_fat_kPa']:g} kPa"
        rows.append(("stiffness", hardness, factor, really))
    return rows


def say_result(
    estimate: Estimate,
    across: AcrossStroke | None,
    together: VisitAnswer | None,
    truth: dict[str, float],
    identical: bool,
    files: dict[str, Path],
    stderr: bool,
) -> None:
    """Print the estimate beside the truth, what the strokes say together, and where the files lie."""
    say(f"   {verdict(estimate, truth)}", err=stderr)
    table(("", "the probe says", _level(estimate), "truth"), rows_of(estimate, across, truth), stderr=stderr)
    if together is not None:
        says = f"{together.strokes} strokes together"
        table((says, "", _level(estimate), "truth"), visit_rows(together, truth), stderr=stderr)
    say(
        f"   {'inside' if estimate.in_domain else 'outside'} the model's domain; "
        f"replay: {'identical' if identical else 'DIFFERENT'}",
        err=stderr,
    )
    for name in ("picture", "recording", "report"):
        say(f"   {name}: {files[name]}", err=stderr)

"""The option `--port`, and an estimate in words, for the commands that talk to a probe."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from firmware_py import geometry, outputs
from palpate.answer import answer_dict
from palpate.answer.card import ROWS
from palpate.answer.visit import HOW, VisitAnswer
from palpate.answer.words import HARDNESS, outside_words, place_words, size_words, stiffness_words
from palpate.cli.numbers import Finite
from palpate.console import note
from palpate.model_export.vocabulary import SHOWN_UNITS, WORDS
from palpate.spans import Span, stiffness_kPa, without_minus_zero

if TYPE_CHECKING:
    from palpate.answer.layers import LumpLayer
    from palpate.answer.told import AcrossStroke, Told
    from palpate.link.probe import Probe
    from palpate.wire.events import Estimate

F = TypeVar("F", bound=Callable[..., Any])

NOMINAL_SCALE = (
    f"pressures are by the nominal scale ({geometry.FULL_SCALE_PA / 1000:g} kPa over {geometry.FULL_COUNT} "
    f"counts, {geometry.PEDESTAL_PA / 1000:g} kPa the zero)"
)


def port_option(function: F) -> F:
    """`--port` and `--baud`, the same words everywhere."""
    where = "auto, a serial number, a port (/dev/ttyACM0, COM5) or socket://HOST:PORT."
    function = click.option(
        "--baud", type=click.IntRange(50, 100_000_000), default=921_600, show_default=True, help="Of a UART."
    )(function)
    return click.option("--port", default="auto", show_default=True, help=where)(function)


def tell_damage(probe: Probe) -> None:
    """Say on standard error what the probe has found damaged in its store."""
    for damage in probe.identity.damaged:
        note(f"the probe found damaged in its store: {damage}")


def fat_option(function: F) -> F:
    """`--fat`, the same words everywhere."""
    return click.option(
        "--fat",
        "fat_kPa",
        type=Finite(0.1, 1000.0),
        metavar="KPA",
        help="Young's modulus of the fat, where it is known: stiffness is said in kPa, too.",
    )(function)


def document_option(function: F) -> F:
    """`--document`, the same words everywhere."""
    return click.option(
        "--document",
        type=click.Path(path_type=Path),
        metavar="MODEL.JSON",
        help="What `palpate fit` wrote of the probe's model, for width and place across, or the layer; "
        "models that come with Palpate are found.",
    )(function)


def estimate_dict(
    estimate: Estimate, fat_kPa: float | None = None, told: Told | None = None
) -> dict[str, Any]:
    """An estimate for programs, with `E_kPa` where the fat is known, or estimated, and what was worked out
    here."""
    out = answer_dict(estimate, told)
    fat = estimate.fat_kPa(fat_kPa)
    if fat is not None and "E_inv23" in estimate.outputs:
        out["E_kPa"] = dict(zip(outputs.PARTS, stiffness_kPa(estimate.span("E_inv23"), fat)))
    return out


def estimate_lines(estimate: Estimate, fat_kPa: float | None = None, told: Told | None = None) -> list[str]:
    """An estimate for people: one line each, intervals beside the values, reservations in plain words."""
    head = f"stroke {estimate.stroke}, {estimate.frames} frames"
    if not estimate.lump and estimate.reason == "no lump found":
        return [f"{head}: no lump found"]
    if not estimate.valid:
        return [f"{head}: no estimate, {estimate.reason}"]
    level = f"{estimate.level_permille / 10:g} % interval"
    layer = None if told is None else told.layer
    lines = [f"{head}, model {estimate.model_id.hex()}"]
    for name in estimate.outputs:
        lines.append(_number(WORDS[name], SHOWN_UNITS[name], estimate.span(name), level))
        depth = layer.depth_mm if layer is not None else estimate.depth_mm
        if name == "h" and depth is not None:
            lines.append(_number("lump depth", "mm", depth, level))
    lines += _across_lines(None if told is None else told.across)
    lines += _layer_lines(layer)
    if "E_inv23" in estimate.outputs:
        factor = stiffness_words(estimate.span("E_inv23"), estimate.fat_kPa(fat_kPa))
        lines += [f"  {'stiffness':20} {factor}", f"  {HARDNESS[estimate.hardness]}"]
    if not estimate.calibrated:
        lines.append("  the probe has lost its calibration: do not rely on the numbers")
    if not estimate.in_domain:
        lines.append("  outside what the model was trained on: do not rely on the numbers")
        if why := outside_words(() if told is None else told.outside):
            lines.append(f"  {'perhaps because':20} {why}")
    lines.append("  research use, not a diagnosis")
    return lines


def visit_lines(answer: VisitAnswer, fat_kPa: float | None = None) -> list[str]:
    """What the strokes over one lump say together, for people."""
    level = f"{100 * answer.level:g} % interval"
    left_out = f", {answer.left_out} left out" if answer.left_out else ""
    lines = [f"together, if over one lump: {answer.strokes} strokes{left_out}"]
    for row in ROWS:
        if row.key in answer.spans:
            lines.append(_number(row.label.lower(), row.unit, answer.spans[row.key], level))
    if answer.hardness:
        lines += [f"  {'stiffness':20} {answer.stiffness_words(fat_kPa)}", f"  {HARDNESS[answer.hardness]}"]
    return [*lines, f"  {HOW}"]


def _across_lines(across: AcrossStroke | None) -> list[str]:
    if across is None:
        return []
    level = f"{100 * across.level:g} % interval"
    spans = (("width across", across.width_mm), ("place across", across.place_mm))
    return [_number(words, "mm", without_minus_zero(span), level) for words, span in spans if span]


def _layer_lines(layer: LumpLayer | None) -> list[str]:
    if layer is None:
        return []
    value, low, high = (100 * min(max(share, 0.0), 1.0) for share in layer.in_fat)
    level = f"{100 * layer.level:g} % interval"
    lines = [f"  {'lies':20} {place_words(layer.place, layer.odds)}"]
    if low < high:  # else it lies wholly on one side
        lines.append(f"  {'of its height in fat':20} {value:.0f} % ({low:.0f} to {high:.0f}, {level})")
    if layer.worth_saying:
        lines.append(f"  {'size and stiffness':20} {size_words(layer.sizes, layer.within)}")
    return lines


def _number(words: str, unit: str, span: Span, level: str) -> str:
    value, low, high = span
    if high - low <= 1e-4 * abs(value):  # the model was told it; the probe rounds each end by itself
        return f"  {words:20} {value:8.3f} {unit:4} (assumed, not measured)"
    return f"  {words:20} {value:8.3f} {unit:4} ({low:.3f} to {high:.3f}, {level})"

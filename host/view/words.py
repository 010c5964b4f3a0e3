"""An estimate in plain words: what the card says, and what it keeps silent about."""

from __future__ import annotations

import math
from typing import Any

from host.view.events import Estimate, Interval

NOT_A_DIAGNOSIS = "Research use, not a diagnosis."
"""Stands on every card, picture and table."""

BOUND_TO = 50.0
"""An upper bound of E beyond this is none: such lumps feel alike."""

_TITLES = {
    "lump": "Lump found",
    "none": "No lump found",
    "outside": "Outside what the model knows",
    "force_low": "Force too low",
    "force_high": "Force too high",
    "force": "Force out of range",
    "unread": "Stroke could not be read",
    "no_model": "No model on the probe",
    "missing": "No answer from the probe",
}
_TEXTS = {
    "none": "The tactile map shows no bump that stands out of its base. "
    "A small, deep or soft lump can hide from one stroke.",
    "outside": "This stroke is unlike those the model was fitted to. "
    "The numbers are extrapolated: do not rely on them.",
    "force_low": "Press harder and stroke again: at this force the tissue hides what is in it.",
    "force_high": "Press more gently and stroke again.",
    "force": "The mean force lies outside the range the model was fitted to. "
    "Stroke again with another force.",
    "unread": "The stroke was too short, too fast or too uneven for an answer. Stroke again.",
    "no_model": "The probe felt the stroke and cannot judge it. Put a model on it with `palpate flash`.",
    "missing": "The stroke ended and no estimate came: the link broke, or the probe was reset.",
}
_HARDNESS = {
    "hard": "hard: ten times as stiff as fat, or more",
    "soft": "soft: less than ten times as stiff as fat",
    "unsure": "hard or soft: this stroke does not tell",
}


def depth_mm(t_mm: Interval, d_mm: Interval) -> Interval:
    """Fat over the lump, t - d/2 (thesis: t = d (h + 1/2)); the half-widths of t and d/2 add as squares."""
    value = t_mm.value - d_mm.value / 2
    low = value - math.hypot(t_mm.value - t_mm.low, (d_mm.high - d_mm.value) / 2)
    high = value + math.hypot(t_mm.high - t_mm.value, (d_mm.value - d_mm.low) / 2)
    return Interval(max(value, 0.0), max(low, 0.0), max(high, 0.0))


def stiffness(E_inv23: Interval) -> tuple[float | None, float | None, float | None]:
    """E over fat from E^-2/3: value, low, high; None stands for no bound, for the physics saturates above
    E = 10."""

    def ratio(x: float) -> float | None:
        return x**-1.5 if x > 1e-3 else None

    high = ratio(E_inv23.low)
    return ratio(E_inv23.value), ratio(E_inv23.high), None if high is None or high > BOUND_TO else high


def verdict(estimate: Estimate | None, *, force_low: bool = False, force_high: bool = False) -> str:
    """Which kind of card: a key of the titles; what is wrong with the stroke comes before what is in it."""
    if estimate is None:
        return "missing"
    if estimate.no_model:
        return "no_model"
    if estimate.force_out:
        return "force_low" if force_low else "force_high" if force_high else "force"
    if estimate.invalid:
        return "unread"
    if not estimate.lump:
        return "none"
    return "lump" if estimate.in_domain else "outside"


def card(estimate: Estimate | None, *, force_low: bool = False, force_high: bool = False) -> dict[str, Any]:
    """What the page writes on the estimate card.

    Returns
    -------
    dict
        kind, title, text; `rows` with key, label, unit, value, low, high (only what may be said for this
        kind); hardness and its words; E_ratio (value, low, high; null means unbounded); level; model_id;
        notice.
    """
    kind = verdict(estimate, force_low=force_low, force_high=force_high)
    out: dict[str, Any] = {
        "kind": kind,
        "title": _TITLES[kind],
        "text": _TEXTS.get(kind, ""),
        "rows": [],
        "hardness": None,
        "hardness_text": "",
        "E_ratio": None,
        "level": None,
        "model_id": "",
        "notice": NOT_A_DIAGNOSIS,
    }
    if estimate is None:
        return out
    out["level"], out["model_id"] = estimate.level, estimate.model_id
    if kind == "unread" and estimate.status_text:
        out["text"] = f"{estimate.status_text[:1].upper()}{estimate.status_text[1:]}. Stroke again."

    def row(key: str, label: str, unit: str, interval: Interval | None) -> None:
        if interval is not None:
            out["rows"].append(
                {
                    "key": key,
                    "label": label,
                    "unit": unit,
                    "value": interval.value,
                    "low": interval.low,
                    "high": interval.high,
                }
            )

    if kind in ("lump", "outside"):
        row("d_mm", "Diameter", "mm", estimate.d_mm)
        if estimate.t_mm is not None and estimate.d_mm is not None:
            row("depth_mm", "Depth", "mm", depth_mm(estimate.t_mm, estimate.d_mm))
        row("t_mm", "Tissue thickness", "mm", estimate.t_mm)
        out["hardness"] = estimate.hardness
        out["hardness_text"] = _HARDNESS.get(estimate.hardness, "")
        if estimate.E_inv23 is not None:
            value, low, high = stiffness(estimate.E_inv23)
            out["E_ratio"] = {"value": value, "low": low, "high": high}
    row("F_N_per_m", "Force", "N/m", estimate.F_N_per_m)
    return out

"""An estimate in plain words: what the card shows, and what it leaves out."""

from __future__ import annotations

from typing import Any

from palpate.across.layers import LumpLayer
from palpate.link import answer
from palpate.model_export.vocabulary import SHOWN_UNITS, WORDS
from palpate.view.events import Estimate, Interval

NOT_A_DIAGNOSIS = "Research use, not a diagnosis."
"""Stands on every card, picture and table."""

_TITLES = {
    "lump": "Lump found",
    "none": "No lump found",
    "outside": "Outside what the model knows",
    "force_low": "Force too low",
    "force_high": "Force too high",
    "force": "Force out of range",
    "unread": "Stroke could not be read",
    "no_model": "No model on the probe",
    "uncalibrated": "Calibration lost",
    "missing": "No answer from the probe",
}
_TEXTS = {
    "none": "The tactile map shows no bump that stands out of its base. "
    "A small, deep or soft lump can hide from one stroke.",
    "outside": "The numbers are extrapolated: do not rely on them.",
    "force_low": "Press harder and stroke again: at this force the tissue hides what is in it.",
    "force_high": "Press more gently and stroke again.",
    "force": "Outside the forces that the model was fitted to. Stroke again with another.",
    "unread": "The stroke was too short, too fast or too uneven for an answer. Stroke again.",
    "no_model": "The probe felt the stroke and cannot judge it: nobody has put a model on it.",
    "uncalibrated": "The calibration that the probe had stored is damaged. Calibrate it, then stroke again.",
    "missing": "The stroke ended and no estimate came: the link broke, or the probe was reset.",
}
_REFERENCE = {
    "used": "With the reference press.",
    "unlike": "The reference press is of another place: it was left out. Take one beside this place.",
}


def _fat(estimate: Estimate, told: float | None) -> answer.Span | None:
    """The fat's modulus: what was told, or else estimated."""
    if told is not None:
        return told, told, told
    found = estimate.further.get("E_fat_kPa")
    return None if found is None or found.low <= 0 else _span(found)


def depth_mm(t_mm: Interval, d_mm: Interval, h: Interval) -> Interval:
    """Fat over the lump; see `palpate.link.answer`."""
    return Interval(*answer.depth_mm(_span(t_mm), _span(d_mm), _span(h)))


def _layer(layer: LumpLayer | None) -> dict[str, Any] | None:
    """Where the lump lies: the words, the share of its height in the fat within 0 and 1, and the sizes."""
    if layer is None:
        return None
    value, low, high = (min(max(share, 0.0), 1.0) for share in layer.in_fat)
    sizes = answer.size_words(layer.sizes, layer.within) if layer.worth_saying else ""
    text = answer.place_words(layer.place, layer.odds)
    return {"place": layer.place, "text": text, "value": value, "low": low, "high": high, "sizes": sizes}


def _span(interval: Interval) -> answer.Span:
    return interval.value, interval.low, interval.high


def verdict(estimate: Estimate | None, *, force_low: bool = False, force_high: bool = False) -> str:
    """Which kind of card: a key of the titles; what is wrong with the stroke comes before what is in it."""
    if estimate is None:
        return "missing"
    if estimate.no_model:
        return "no_model"
    if estimate.uncalibrated:
        return "uncalibrated"
    if estimate.force_out:
        return "force_low" if force_low else "force_high" if force_high else "force"
    if estimate.invalid:
        return "unread"
    if not estimate.lump:
        return "none"
    return "lump" if estimate.in_domain else "outside"


def card(
    estimate: Estimate | None,
    *,
    force_low: bool = False,
    force_high: bool = False,
    fat_kPa: float | None = None,
) -> dict[str, Any]:
    """What the page writes on the estimate card; with the fat's modulus stiffness is said in kPa, too.

    Returns
    -------
    dict
        kind, title, text; `rows` with key, label, unit, value, low, high and, for the depth, h `beside` it
        (only what may be said for this kind); hardness and its words; E_ratio (value, low, high; null means
        unbounded) and its words; `layer`, where the lump lies (`_layer`), or null; level; model_id; what
        became of the reference press; notice.
    """
    kind = verdict(estimate, force_low=force_low, force_high=force_high)
    out: dict[str, Any] = {
        "kind": kind,
        "title": _TITLES[kind],
        "text": _TEXTS.get(kind, ""),
        "rows": [],
        "hardness": None,
        "hardness_text": "",
        "stiffness_text": "",
        "E_ratio": None,
        "layer": None,
        "level": None,
        "model_id": "",
        "reference": "",
        "notice": NOT_A_DIAGNOSIS,
    }
    if estimate is None:
        return out
    out["level"], out["model_id"] = estimate.level, estimate.model_id
    if kind == "outside" and (why := answer.outside_words(estimate.outside)):
        out["text"] += f" Perhaps {why}."
    if kind in ("lump", "outside"):
        out["reference"] = _REFERENCE.get(estimate.reference, "")
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
        row("width_mm", "Width across", "mm", estimate.width_mm)
        if estimate.t_mm is not None and estimate.d_mm is not None and (h := estimate.h) is not None:
            layer = estimate.layer
            tied = depth_mm(estimate.t_mm, estimate.d_mm, h)
            row("depth_mm", "Depth", "mm", tied if layer is None else Interval(*layer.depth_mm))
            out["rows"][-1]["beside"] = {"label": "h", "value": h.value, "low": h.low, "high": h.high}
        row("place_mm", "Place across", "mm", estimate.place_mm)
        row("t_mm", "Tissue thickness", "mm", estimate.t_mm)
        for name, interval in estimate.further.items():
            row(name, WORDS[name][:1].upper() + WORDS[name][1:], SHOWN_UNITS[name], interval)
        out["hardness"] = estimate.hardness
        out["hardness_text"] = answer.HARDNESS.get(estimate.hardness, "")
        if estimate.E_inv23 is not None:
            value, low, high = answer.stiffness(_span(estimate.E_inv23))
            out["E_ratio"] = {"value": value, "low": low, "high": high}
            out["stiffness_text"] = answer.stiffness_words(_span(estimate.E_inv23), _fat(estimate, fat_kPa))
        out["layer"] = _layer(estimate.layer)
    if kind != "none":  # the probe sends zeros where it finds no lump
        row("F_N_per_m", "Force", "N/m", estimate.F_N_per_m)
    return out

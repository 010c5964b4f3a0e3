"""An estimate in plain words: what the card shows, and what it leaves out."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from firmware_py import status
from firmware_py.outputs import NAMES, PARTS
from palpate.answer import words
from palpate.model_export.vocabulary import SHOWN_UNITS, WORDS
from palpate.spans import Span, stiffness
from palpate.wire.events import Estimate

if TYPE_CHECKING:
    from palpate.answer.layers import LumpLayer
    from palpate.answer.told import Told

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


def _span(said: Estimate, name: str) -> Span | None:
    return said.span(name) if name in said.outputs else None


def _output(name: str, label: str = "", of_a_lump: bool = True) -> CardRow:
    label = label or WORDS[name][:1].upper() + WORDS[name][1:]
    return CardRow(name, label, SHOWN_UNITS[name], lambda said, told: _span(said, name), of_a_lump)


def _across(key: str, label: str) -> CardRow:
    return CardRow(key, label, "mm", lambda said, told: getattr(told and told.across, key, None))


def _depth(said: Estimate, told: Told | None) -> Span | None:
    layer = None if told is None else told.layer
    return said.depth_mm if layer is None else layer.depth_mm


class CardRow(NamedTuple):
    """A number on the card: its key, label and unit, and where it comes from; None leaves it out.

    `of_a_lump`: whether it means nothing without one.
    """

    key: str
    label: str
    unit: str
    of: Callable[[Estimate, Told | None], Span | None]
    of_a_lump: bool = True


_TOLD_OTHERWISE = {"d_mm", "t_mm", "F_N_per_m", "h", "E_inv23"}
ROWS = (
    _output("d_mm", "Diameter"),
    _across("width_mm", "Width across"),
    CardRow("depth_mm", "Depth", "mm", _depth),
    _across("place_mm", "Place across"),
    _output("t_mm", "Tissue thickness"),
    *(_output(name) for name in NAMES if name not in _TOLD_OTHERWISE),
    _output("F_N_per_m", "Force", of_a_lump=False),
)
"""The card from top to bottom; page, pictures and tables follow."""


def _layer(layer: LumpLayer | None) -> dict[str, Any] | None:
    """Where the lump lies: the words, the share of its height in the fat within 0 and 1, and the sizes."""
    if layer is None:
        return None
    value, low, high = (min(max(share, 0.0), 1.0) for share in layer.in_fat)
    sizes = words.size_words(layer.sizes, layer.within) if layer.worth_saying else ""
    text = words.place_words(layer.place, layer.odds)
    return {"place": layer.place, "text": text, "value": value, "low": low, "high": high, "sizes": sizes}


def verdict(estimate: Estimate | None, *, force_low: bool = False, force_high: bool = False) -> str:
    """Which kind of card: a key of the titles; what is wrong with the stroke comes before what is in it."""
    if estimate is None:
        return "missing"
    if estimate.status == status.NO_MODEL:
        return "no_model"
    if not estimate.calibrated:
        return "uncalibrated"
    if estimate.force_out:
        return "force_low" if force_low else "force_high" if force_high else "force"
    if estimate.unread:
        return "unread"
    if not estimate.lump:
        return "none"
    return "lump" if estimate.in_domain else "outside"


def card(
    estimate: Estimate | None,
    told: Told | None = None,
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
    out["level"] = estimate.level_permille / 1000
    out["model_id"] = estimate.model_id.hex() if any(estimate.model_id) else ""
    if kind == "outside" and told is not None and (why := words.outside_words(told.outside)):
        out["text"] += f" Perhaps {why}."
    if kind == "unread" and estimate.status != status.OK:
        out["text"] = f"{estimate.reason[:1].upper()}{estimate.reason[1:]}. Stroke again."
    if kind in ("lump", "outside"):
        out["reference"] = _REFERENCE.get(estimate.reference, "")
        out["hardness"] = estimate.hardness
        if (E_inv23 := _span(estimate, "E_inv23")) is not None:
            out["hardness_text"] = words.HARDNESS.get(estimate.hardness, "")
            out["E_ratio"] = dict(zip(PARTS, stiffness(E_inv23)))
            out["stiffness_text"] = words.stiffness_words(E_inv23, estimate.fat_kPa(fat_kPa))
        out["layer"] = None if told is None else _layer(told.layer)
    for row in ROWS:
        # The probe sends zeros where it finds no lump.
        means_something = kind in ("lump", "outside") or (kind != "none" and not row.of_a_lump)
        if means_something and (span := row.of(estimate, told)) is not None:
            shown = {"key": row.key, "label": row.label, "unit": row.unit, **dict(zip(PARTS, span))}
            if row.key == "depth_mm" and "h" in estimate.outputs:
                shown["beside"] = {"label": "h", **estimate.outputs["h"]}
            out["rows"].append(shown)
    return out

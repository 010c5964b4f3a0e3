"""Pictures and tables to take away. Every one carries the model's id and says that it is no diagnosis."""

from __future__ import annotations

import base64
import csv
import io
import json
from datetime import UTC, datetime
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.answer.card import NOT_A_DIAGNOSIS, ROWS
from palpate.features.gaussian import bump
from palpate.report import stroke_panels, style
from palpate.stroke.area import Strip
from palpate.view.lump_outline import draw_outline, felt_across
from palpate.wire.cells import PITCH_MM, SHAPE

STROKE_KINDS = ("json", "csv", "png", "svg")
_ENDS = {"value": "", "low": "_low", "high": "_high"}
"""What a column is called that has this part of a number."""


def table(snapshot: dict[str, Any]) -> bytes:
    """All strokes as CSV, one line each: what the card says, with intervals."""
    visits = {v["number"]: v["name"] for v in snapshot["visits"]}
    of_the_card = [row.key + end for row in ROWS for end in _ENDS.values()]
    stiffness = ["hardness", *("E_ratio" + end for end in _ENDS.values())]
    rest = ["level", "model_id", "lane_mm", "frames", "lost", "notice"]
    out = io.StringIO()
    names = ["stroke", "visit", "utc", "verdict", *of_the_card, *stiffness, *rest]
    writer = csv.DictWriter(out, names, lineterminator="\n")
    writer.writeheader()
    for stroke in snapshot["strokes"]:
        card = stroke["card"]
        line = {
            "stroke": stroke["number"],
            "visit": _plain(visits.get(stroke["visit"], "")),
            "utc": datetime.fromtimestamp(stroke["wall_time"], UTC).isoformat(timespec="seconds"),
            "verdict": card["title"],
            "hardness": card["hardness"],
            "level": card["level"] or "",
            "model_id": card["model_id"],
            "lane_mm": stroke["lane_mm"],
            "frames": stroke["frames"],
            "lost": stroke["gaps"],
            "notice": NOT_A_DIAGNOSIS,
        }
        for row in [*card["rows"], {"key": "E_ratio", **(card["E_ratio"] or {})}]:
            line |= {
                row["key"] + end: f"{v:.6g}"
                for part, end in _ENDS.items()
                if (v := row.get(part)) is not None
            }
        writer.writerow(line)
    return out.getvalue().encode()


def stroke(detail: dict[str, Any], kind: str) -> tuple[bytes, str]:
    """One stroke (`Stroke.detail()`) as json, csv, png or svg: the bytes and their media type."""
    if kind == "json":
        return json.dumps(detail).encode(), "application/json"
    if kind == "csv":
        return _traces(detail), "text/csv"
    out = io.BytesIO()
    with style.look():
        metadata = {"Date": None} if kind == "svg" else None
        stroke_figure(detail).savefig(out, format=kind, dpi=160, metadata=metadata)
    return out.getvalue(), "image/png" if kind == "png" else "image/svg+xml"


def strip(found: Strip) -> dict[str, Any]:
    """A stroke's strip of the visit's map: thousandths over the base, place by place along the stroke, each
    from left to right."""
    x_mm = found.x_mm
    return {
        "from_mm": float(x_mm[0]) if x_mm.size else 0.0,
        "places": int(x_mm.size),
        "columns": SHAPE[1],
        "rise_permille": np.clip(np.rint(found.rise * 1000), -32768, 32767).astype(int).ravel().tolist(),
    }


def stroke_figure(detail: dict[str, Any]) -> Figure:
    """Image at its highest pressure with the lump's outline, map with its fit, displacement, words."""
    figure = style.new(9.0, 5.6)
    axes = figure.subplots(2, 2, width_ratios=(1, 1.15))
    images = detail["images"]
    stack = np.frombuffer(base64.b64decode(images["uint16"]), "<u2").reshape(-1, *SHAPE)
    if len(stack):
        best = int(stack.max(axis=(1, 2)).argmax())
        pressure, half = stack[best] * images["step_kPa"], (SHAPE[1] * PITCH_MM / 2, SHAPE[0] * PITCH_MM / 2)
        edges, title = (
            (-half[0], half[0], -half[1], half[1]),
            f"Tactile image at {images['position_mm'][best]:.1f} mm",
        )
        shown = stroke_panels.tactile_image(axes[0, 0], pressure, edges, pressure.max(), title)
        figure.colorbar(shown, ax=axes[0, 0], label="kPa", shrink=0.8)
        if detail["lump"] is not None:
            draw_outline(axes[0, 0], detail["lump"], images["position_mm"][best])
    x, fit, curve = np.asarray(detail["map"]["x_mm"]), detail["fit"], None
    if fit is not None and x.size:
        fine = np.linspace(x.min(), x.max(), 300)
        curve = fine, bump(fine, fit["base_kPa"], fit["amp_kPa"], fit["centre_mm"], fit["stdev_mm"])
    stroke_panels.tactile_map(axes[0, 1], x.tolist(), detail["map"]["pressure_kPa"], curve)
    traces = detail["traces"]
    stroke_panels.displacement(axes[1, 1], traces["position_mm"], traces["displacement_mm"])
    _words(axes[1, 0], detail)
    return figure


def _words(ax: Axes, detail: dict[str, Any]) -> None:
    """What the card says, and what is known of the lump across the stroke."""
    card, lump, number = detail["card"], detail["lump"], detail["number"]
    ax.axis("off")
    lines = [
        f"{r['label']}: {r['value']:.1f} {r['unit']}  ({r['low']:.1f} to {r['high']:.1f})"
        + (f", {b['label']} {b['value']:.2f}" if (b := r.get("beside")) else "")
        for r in card["rows"]
    ]
    if lump is not None and lump["width_mm"] is None:  # else the card's rows have it
        lines.append(felt_across(lump))
    if card["hardness"]:
        lines.append(f"Stiffness: {card['hardness']}, {card['stiffness_text']}")
    if card["layer"]:
        lines.append(f"Lies {card['layer']['text']}")
    if card["level"]:
        lines.append(f"Intervals hold the truth {card['level']:.0%} of the time.")
    lines += ["", f"Stroke {number}, model {card['model_id'] or 'none'}", NOT_A_DIAGNOSIS]
    ax.text(0, 1, card["title"], fontsize=13, weight="bold", va="top", transform=ax.transAxes)
    ax.text(0, 0.84, "\n".join(lines), fontsize=8.5, va="top", linespacing=1.5, transform=ax.transAxes)


def _traces(detail: dict[str, Any]) -> bytes:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    names = ("position_mm", "displacement_mm", "force_N_per_m")
    writer.writerow(names)
    writer.writerows(zip(*(detail["traces"][n] for n in names), strict=True))
    return out.getvalue().encode()


def _plain(text: str) -> str:
    """Keep a spreadsheet from reading a visit's name as a formula."""
    return f"'{text}" if text[:1] in tuple("=+-@\t\r") else text

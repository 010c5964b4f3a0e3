"""Refined answers: the probe's estimate beside the fit by the forward model, and the fitted stroke over the
measured one. Units: mm, kPa."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.answer.fitted import ROWS, TITLES, Inverted, Laid
from palpate.report import pages, style
from palpate.report.items import Item
from palpate.report.writer import drawn
from palpate.stroke.read import load_strokes
from palpate.stroke.stroke import FollowedStroke

_FIRST = 4
"""What goes beyond the thesis is counted on from a model's own figures."""
_ROWS_SHOWN = 4
_NOTHING = "not told"


def items(recordings: Mapping[Path, Sequence[Inverted]]) -> list[Item]:
    """A table and a figure of each refined answer of some recordings."""
    found: list[Item] = []
    for recording, answers in recordings.items():
        said = iter(load_strokes(recording) if answers else ())
        for answer in answers:
            card = None if answer.press or answer.together > 1 else _card(said, answer.stroke)
            found += _items_of(recording.name, answer, card)
    return [replace(item, name=f"Beyond {_FIRST + k}") for k, item in enumerate(found)]


def write_refined(directory: str | PathLike[str], recordings: Mapping[Path, Sequence[Inverted]]) -> Path:
    """Write the refined answers of recordings as a page that needs no other file; its path."""
    target = Path(directory)
    target.mkdir(parents=True, exist_ok=True)
    with style.look():
        parts = [{"item": item, "png": drawn(item, target)} for item in items(recordings)]
    title = f"Refined: {', '.join(path.name for path in recordings)}"
    text = pages.render("palpate.report", "refined.html", title=title, parts=parts)
    return pages.written(target, text)


def _card(said: Iterator[FollowedStroke], number: int) -> dict[str, Any]:
    """The card of the next stroke of this number; of none, if the probe has told nothing."""
    for stroke in said:
        if stroke.estimate is not None and stroke.estimate.stroke == number:
            card: dict[str, Any] = stroke.summary()["card"]
            return card
    return {"rows": [], "hardness": None, "title": _NOTHING}


def _items_of(name: str, answer: Inverted, card: dict[str, Any] | None) -> Iterator[Item]:
    what = f"{'Press' if answer.press else 'Stroke'} {answer.stroke}"
    if answer.problem:
        yield Item("", f"Of {name}. Not refined: {answer.problem}.", beyond=what)
        return
    rest = "" if answer.settled else " The search had not come to rest."
    misfit = f"Misfit {answer.chi2:.2f}, worst in {answer.worst}. Odds: {answer.odds}."
    text = f"Of {name}. {answer.verdict} {misfit}{rest}"
    for k, laid in enumerate(answer.laid):
        one = what if answer.together == 1 else f"{answer.together} strokes together: stroke {k + 1}"
        tables = [("", _table(answer, card))] if k == 0 else []
        yield Item("", text if k == 0 else "", draw=partial(figure, laid), tables=tables, beyond=one)


def _table(answer: Inverted, card: dict[str, Any] | None) -> pd.DataFrame:
    """Quantity by quantity: the probe's estimate, the refined one, each with its interval."""
    rows = {key: (label, unit) for key, label, unit in ROWS if key in answer.values}
    told = {} if card is None else {row["key"]: row for row in card["rows"]}
    table = []
    for key, (label, unit) in rows.items():
        refined = answer.values[key].as_dict()
        probe = _span(told[key], unit) if key in told else _NOTHING
        table.append((label, probe, _span(refined, unit)))
    if answer.lump:
        table.append(("Hard or soft", str((card or {}).get("hardness") or _NOTHING), answer.hardness))
    verdict = str((card or {}).get("title", _NOTHING))
    table.append(("In a word", verdict, TITLES[answer.kind]))
    shown = pd.DataFrame(table, columns=["", "probe", "refined"])
    return shown.drop(columns=[] if card else ["probe"])


def _span(value: Mapping[str, object], unit: str) -> str:
    low, high = (value[end] for end in ("low", "high"))
    ends = f"over {low:.1f}" if high is None else f"{low or 0:.1f} to {high:.1f}"
    return f"{value['value']:.1f} {unit} ({ends})"


def figure(laid: Laid) -> Figure:
    """Row means and displacement, measured and fitted, and the rows' residual: along the stroke, or frame by
    frame of a press."""
    shown = style.new(8.4, 5.6)
    count, row = len(laid.place_mm), np.arange(1, laid.measured_kPa.shape[1] + 1)
    press = laid.press == count
    rows, depth, left = shown.subplots(3, 1, sharex=not press, height_ratios=(2, 1, 1.3))
    if press:
        frames, x = np.arange(count), np.arange(1.0, count + 1)
        for k, colour in enumerate(style.ramp(count)):
            _fitted(rows, row, laid.measured_kPa[k], laid.fitted_kPa[k], colour, f"frame {k + 1}")
        rows.set_xlabel("row")
    else:
        frames = laid.press + np.argsort(laid.place_mm[laid.press :])
        x = laid.place_mm[frames]
        chosen = np.linspace(0, len(row) - 1, _ROWS_SHOWN).round().astype(int)
        for k, colour in zip(chosen, style.ramp(_ROWS_SHOWN)):
            measured, fitted = laid.measured_kPa[frames, k], laid.fitted_kPa[frames, k]
            _fitted(rows, x, measured, fitted, colour, f"row {row[k]}")
    rows.set(ylabel="row's mean (kPa)", title="Measured (points) and fitted (lines)")
    style.beside(rows)
    depth.plot(x, laid.measured_mm[frames], "o", ms=2.5, color=style.BLUE)
    depth.plot(x, laid.fitted_mm[frames], color=style.ORANGE, lw=1)
    depth.set_ylabel("depth (mm)")
    _residual(left, x, laid.residual_kPa[frames])
    left.set(xlabel="frame of the press" if press else "position of the probe (mm)", ylabel="row")
    return shown


def _fitted(
    ax: Axes, x: np.ndarray, measured: np.ndarray, fitted: np.ndarray, colour: Any, label: str
) -> None:
    ax.plot(x, measured, "o", ms=2.5, color=colour, label=label)
    ax.plot(x, fitted, color=colour, lw=1)


def _residual(ax: Axes, x: np.ndarray, residual_kPa: np.ndarray) -> None:
    """An image, row by row, of what the fit leaves."""
    top = max(float(np.abs(residual_kPa).max()), 1e-3)
    row = np.arange(1, residual_kPa.shape[1] + 1)
    image = ax.pcolormesh(
        x, row, residual_kPa.T, cmap="RdBu_r", vmin=-top, vmax=top, shading="nearest", rasterized=True
    )
    ax.grid(visible=False)
    ax.set_title("Measured less fitted")
    ax.figure.colorbar(image, ax=ax, label="kPa")

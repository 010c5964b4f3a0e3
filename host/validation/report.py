"""A validation as a page: `index.html`, and a figure of each output with Bland and Altman's plot."""

from __future__ import annotations

import base64
import io
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from palpate.dataset.agreement import Agreement, Estimated
from palpate.dataset.answers import NAMES, OUTPUTS
from palpate.files import whole_file
from palpate.model_export.vocabulary import SHOWN_UNITS
from palpate.report import pages, style
from palpate.validation.result import Validation
from palpate.validation.verdict import percent

UNITS = {"depth_mm": "mm", **SHOWN_UNITS}
_DPI = 150


def write(found: Validation, directory: str | PathLike[str], title: str) -> Path:
    """Write the page and its figures (PNG); the path of the page."""
    target = Path(directory)
    target.mkdir(parents=True, exist_ok=True)
    parts = []
    with style.look():
        for name, a in found.agreements.items():
            png = _png(_figure(found, name, a))
            with whole_file(target / f"{name}.png") as part:
                part.write_bytes(png)
            parts.append({
                "name": name, "words": NAMES[name], "rows": rows_of(a), "verdict": found.verdicts[name].text,
                "png": base64.b64encode(png).decode("ascii"),
            })  # fmt: skip
    facts = shares_of(found)
    text = pages.render(
        "palpate.validation", "page.html",
        title=title, parts=parts, facts=facts, confusion=found.confusion, found=found,
    )  # fmt: skip
    return pages.written(target, text)


def rows_of(a: Agreement) -> list[tuple[str, str]]:
    """An output's numbers as text: what, and value with its interval."""
    low, high = a.limits
    return [
        ("bias", _spanned(a.bias, lambda v: percent(v, a.absolute))),
        ("limits of agreement", f"{percent(low.value, a.absolute)} to {percent(high.value, a.absolute)}"),
        ("R2", _spanned(a.r2, lambda v: f"{v:.3f}")),
        (
            "median error",
            _spanned(a.median_error, lambda v: f"{v:.3f}" if a.absolute else f"{100 * v:.1f} %"),
        ),
        ("truth inside the interval", _spanned(a.coverage, lambda v: f"{100 * v:.0f} %")),
        ("strokes, lumps", f"{a.strokes}, {a.lumps}"),
    ]


def shares_of(found: Validation) -> list[tuple[str, str]]:
    """What was not found, flagged, or called wrongly, as text."""

    def share(e: Estimated) -> str:
        return _spanned(e, lambda v: f"{100 * v:.1f} %")

    out = [
        ("strokes in which no lump was found", share(found.not_found)),
        ("of the others outside the model's domain", share(found.flagged)),
        ("with a force outside the model's range", share(found.force_out)),
    ]
    if found.wrong_hardness is not None:
        out.append(("called hard or soft, and wrongly", share(found.wrong_hardness)))
    return out


def _spanned(e: Estimated, words: Any) -> str:
    if e.value != e.value:
        return "-"
    return words(e.value) + (f" ({words(e.low)} to {words(e.high)})" if e.low is not None else "")


def _figure(found: Validation, name: str, a: Agreement) -> Figure:
    """Left the estimates with their intervals against the truth, right Bland and Altman's plot."""
    said = found.answers
    j = OUTPUTS.index(name)
    used = said.known(name)
    truth, value = said.truth[used, j], said.value[used, j]
    figure = style.new(8.4, 3.4)
    left, right = figure.subplots(1, 2)
    ends = np.array([min(truth.min(), value.min()), max(truth.max(), value.max())])
    left.plot(ends, ends, color=style.SOFT, linewidth=1)
    spans = np.abs(np.array([value - said.low[used, j], said.high[used, j] - value]))
    left.errorbar(truth, value, yerr=spans, fmt="o", color=style.BLUE, elinewidth=0.6, markersize=3)
    unit = f", {UNITS[name]}" if UNITS[name] else ""
    left.set_xlabel(f"truth{unit}")
    left.set_ylabel(f"estimate{unit}")
    left.set_title(NAMES[name])
    scale = 1.0 if a.absolute else 100.0
    right.plot(a.means, scale * a.errors, "o", color=style.BLUE, markersize=3)
    for e, color in ((a.bias, style.TEAL), (a.limits[0], style.ORANGE), (a.limits[1], style.ORANGE)):
        right.axhline(scale * e.value, color=color, linewidth=1.2)
        if e.low is not None and e.high is not None:
            right.axhspan(scale * e.low, scale * e.high, color=color, alpha=0.15, linewidth=0)
    right.set_xlabel(f"middle of truth and estimate{unit}")
    right.set_ylabel("estimate - truth" if a.absolute else "100 ln(estimate / truth)")
    right.set_title("bias and limits of agreement")
    return figure


def _png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=_DPI, metadata={"Software": None})
    return out.getvalue()

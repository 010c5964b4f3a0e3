"""Puts the report together: `index.html` (one file that needs no other), a PNG and an SVG of each figure."""

from __future__ import annotations

import base64
import io
import logging
from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG

from palpate.files import whole_file
from palpate.report import pages, style
from palpate.report.items import TITLES, Item, Summary, lacking

if TYPE_CHECKING:
    from palpate.learn.result import TissueFit
    from palpate.learn.thesis.fit import ThesisFit
    from palpate.sim.tissue import Stroke

_log = logging.getLogger(__name__)
_PNG_DPI = 170
_OF_THE_RUNS = [*(f"Figure {n}" for n in (13, 17, 18, 19)), "Table 1", *(f"Appendix {a}" for a in "ABC")]
_NO_RUNS = (
    "Needs the thesis' runs: palpate sweep --design thesis --out RUNS, then palpate fit RUNS --kind thesis "
    "--report DIR"
)
_NOT_SIMULATED = "Left out: it needs simulations of its own, which were not asked for."


def write_report(
    directory: str | PathLike[str],
    *,
    strokes: Sequence[Stroke] = (),
    thesis: ThesisFit | None = None,
    field: TissueFit | None = None,
    recording: str | PathLike[str] | None = None,
    weights: Sequence[str | PathLike[str]] = (),
    thickness_mm: float = 30.0,
    simulate: bool = True,
    progress: Callable[[str], None] | None = None,
    summary: Summary | None = None,
    more: Sequence[Item] = (),
) -> Path:
    """Write every result of the thesis, figures and tables, that these data can make.

    Parameters
    ----------
    directory
        Made if it is not there; files of an earlier report are replaced.
    strokes : sequence of Stroke
        Of the thesis' design; with others in it, those of the thesis are picked out.
    thesis : ThesisFit, optional
        For Table 1, Figures 13 and 17 to 19, the appendices.
    field : optional
        The field model's fit, for what goes beyond the thesis.
    recording, weights, thickness_mm
        A recording (Figures 2 and 20) or table (Figure 20) of a real map; measured force curves and the
        thickness of the model they were measured on (Figure 21).
    simulate : bool
        False leaves out what needs simulations of its own: Figures 2, 8, 15, 16 and 21 (about half a
        minute).
    progress : callable, optional
        Told the name of each figure and table before it is made.
    summary : Summary, optional
        A stroke of the reader's own, to stand before the thesis' figures.
    more : sequence of Item, optional
        To stand behind all else, as a recording's refined answers (`refined_figures.items`).

    Returns
    -------
    Path of index.html.
    """
    from palpate.report import (
        held_out_figures,
        map_figures,
        model_figures,
        recording_figures,
        strain_figures,
        tables,
        tissue_figures,
    )

    target = Path(directory)
    target.mkdir(parents=True, exist_ok=True)
    tell = progress or (lambda name: None)
    parts, order = [], {name: place for place, name in enumerate(TITLES)}
    with style.look():
        measured = None if recording is None else Path(recording)
        tell("Figure 2")
        found = [recording_figures.map_2d(measured, simulate=simulate)]
        tell("Figure 8" if simulate else "Figure 6d")
        found += tissue_figures.items(simulate=simulate)
        found += map_figures.items(strokes)
        if thesis is not None:
            found += model_figures.items(thesis)
            found += tables.items(thesis, strokes)
        else:
            found += lacking(_OF_THE_RUNS, _NO_RUNS)
        if simulate:
            tell("Figure 15")
            found += strain_figures.items([Path(w) for w in weights], thickness_mm)
        else:
            found += lacking([f"Figure {n}" for n in (8, 15, 16, 21)], _NOT_SIMULATED)
        found.append(recording_figures.gaussian(measured))
        if field is not None:
            found += held_out_figures.items(field)
        for item in sorted([*found, *more], key=lambda item: order.get(item.name, len(order))):
            tell(item.name)
            parts.append({"item": item, "png": drawn(item, target)})
    return pages.written(target, _page(parts, summary))


def drawn(item: Item, target: Path) -> str:
    """Save a figure's files; returns the PNG in base64, "" for a table."""
    if item.draw is None:
        return ""
    figure = item.draw()
    figure.set_dpi(_PNG_DPI)  # texts are a little wider or narrower at another resolution
    png = io.BytesIO()
    # not by `savefig`, which draws each file twice; the first lays out, and once is enough for both
    FigureCanvasAgg(figure).print_png(png, metadata={"Software": None})
    with whole_file(target / f"{item.slug}.png") as part:
        part.write_bytes(png.getvalue())
    figure.set_layout_engine("none")
    with whole_file(target / f"{item.slug}.svg") as part:
        FigureCanvasSVG(figure).print_svg(part, metadata={"Date": None})
    return base64.b64encode(png.getvalue()).decode("ascii")


def _page(parts: list[dict[str, Any]], summary: Summary | None) -> str:
    made = [p for p in parts if not p["item"].missing]
    told = None
    if summary is not None:
        wide, narrow = (
            base64.b64encode(p.read_bytes()).decode("ascii") for p in (summary.picture, summary.narrow)
        )
        told = {**vars(summary), "png": wide, "narrow_png": narrow}
    numbers = {"made": len(made), "missing": len(parts) - len(made)}
    return pages.render("palpate.report", "template.html", parts=parts, summary=told, **numbers)

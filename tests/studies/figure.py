"""One figure for each study of the field model: errors and intervals against what was varied."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from palpate.learn.conformal import LEVEL
from palpate.report import style
from tests.studies.retrained import Study

_OUTPUTS = (("t", "thickness t"), ("d", "diameter d"), ("h", "depth h"))


def study_figure(study: Study, result: pd.DataFrame) -> Figure:
    """Left: median errors, and the half-width of d's interval. Right: E^-2/3 and hard or soft."""
    with style.look():
        figure = style.new(9.0, 1.3 + 0.3 * max(len(result), 4))
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
        y = np.arange(len(result))[::-1]
        for (name, words), color in zip(_OUTPUTS, style.COLORS):
            left.plot(100 * result[f"{name}_error"], y, "o", color=color, label=f"{words}, median")
        left.plot(
            100 * result["d_half"],
            y,
            "|",
            ms=10,
            mew=2,
            color=style.COLORS[1],
            label=f"diameter d, half of its {100 * LEVEL:g} % interval",
        )
        figure.suptitle(study.title)
        left.set(xlabel="error (%)", xlim=(0, None), ylabel=study.setting)
        left.set_yticks(y, [str(s) for s in result["setting"]])
        right.plot(result["E_inv23_r2"], y, "s", color=style.COLORS[3], label=style.powers("R2 of E^-2/3"))
        right.plot(result["hard_soft"], y, "D", color=style.COLORS[4], label="hard or soft right")
        low = float(min(result["E_inv23_r2"].min(), result["hard_soft"].min()))
        right.set(xlim=(min(0.8, low - 0.05), 1.0), xlabel="stiffness")
        right.locator_params(axis="x", nbins=4)
        figure.legend(loc="outside lower center", ncols=3)
    return figure


def save_study_figure(study: Study, result: pd.DataFrame, path: Path) -> None:
    """Draw a study into a file, as SVG or whatever its suffix says; the same numbers give the same bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure = study_figure(study, result)
    with style.look():
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)

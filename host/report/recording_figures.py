"""Figure 20: a measured tactile map with its Gaussian, from a recording or a table. Units: mm, kPa."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from palpate.report import style
from palpate.report.items import Beside, Item, lacking
from palpate.report.measured import recorded_map
from palpate.report.real_maps import RealMap


def items(recording: Path | None) -> list[Item]:
    """Figure 20 of a recording (.mcap: the stroke whose map is most like a Gaussian) or a table (.csv:
    place in mm, kPa)."""
    if recording is None:
        why = "Needs a recording (.mcap) or a table (.csv: place in mm, pressure in kPa): --recording FILE."
        return lacking(["Figure 20"], why)
    found = recorded_map(recording)
    fit = found.fit
    return [
        Item(
            "Figure 20",
            f"The tactile map of {recording.name} (circles) with the Gaussian on its base, and what is left "
            "over.",
            [
                Beside("difference between map and Gaussian", "very little", f"R2 {found.r2:.4f}"),
                Beside("skewness, of lumps that are no spheres", "slightly skewed", f"{fit.skewness:+.2f}"),
                Beside(
                    "Base, Amp, Stdev",
                    "can be assigned",
                    f"{fit.base_kPa:.3f} kPa, {fit.amp_kPa:.3f} kPa, {fit.stdev_mm:.2f} mm",
                ),
            ],
            lambda: figure_20(found),
        )
    ]


def figure_20(found: RealMap) -> Figure:
    """Map, Gaussian and residual."""
    figure = style.new(8.4, 4.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    fine = np.linspace(found.x_mm[0], found.x_mm[-1], 300)
    above.plot(found.x_mm, found.pressure_kPa, "o", mfc="none", label="measured")
    above.plot(fine, found.fit.curve(fine), label="Gaussian")
    above.set_ylabel("pressure (kPa)")
    above.legend()
    below.axhline(0, color=style.SOFT, lw=0.8)
    below.plot(found.x_mm, found.residual_kPa, ".-", ms=3, lw=0.8)
    below.set(xlabel="place on the tissue (mm)", ylabel="left over (kPa)")
    return figure

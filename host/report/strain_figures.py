"""Figures 15, 16 and 21: strain against force, simulated and measured."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.learn.thesis.strain import StrainForce
from palpate.report import style
from palpate.report.items import Beside, Item
from palpate.report.measured import REFERENCE, measure, pressed, simulated_curves
from palpate.sim.tissue import Case


def items(weights: Sequence[Path] = (), thickness_mm: float = 30.0) -> list[Item]:
    """Figures 15, 16 and, with measured tables of force and displacement, 21.

    Presses the probe on the lump at five forces for each curve: about ten seconds for all.
    """
    by_E = simulated_curves()
    nonlinear = pressed(Case.from_code("d10h08eNLf10"), "E = NL")
    by_d = [pressed(replace(REFERENCE, d_mm=d), f"d = {d:g} mm") for d in (5.0, 10.0, 15.0, 20.0)]
    by_h = [pressed(replace(REFERENCE, h=h), f"h = {h:g}") for h in (0.3, 0.5, 0.8, 1.2, 1.5)]
    worst = min(c.r2 for c in by_E.values())
    forces = [float(c(0.15)) for c in by_E.values()]
    steeper = all(a < b for a, b in itertools.pairwise(forces))
    low, high = _acts_like(by_E, nonlinear, 0), _acts_like(by_E, nonlinear, -1)
    return [
        Item(
            "Figure 15",
            "Nominal strain over the lump against force, each stiffness with its curve A S^B; on the right "
            "the lump that stiffens as it is strained.",
            [
                Beside("form", "A Strain^B", f"R2 at least {worst:.4f}"),
                Beside("force at equal strain grows with E", "yes", "yes" if steeper else "no"),
                Beside("nonlinear lump at F = .2", "like E = 1 or 2", f"like E = {low:.1f}"),
                Beside("nonlinear lump at F = 1", "like E = 10 or more", f"like E = {high:.1f}"),
            ],
            lambda: figure_15(list(by_E.values()), nonlinear),
        ),
        Item(
            "Figure 16",
            "The same for other diameters and depths.",
            [Beside("effect of d and h", "less drastic than that of E", _spread(by_E, by_d, by_h))],
            lambda: figure_16(by_d, by_h),
        ),
        _measured(weights, thickness_mm),
    ]


def _acts_like(by_E: dict[float, StrainForce], measured: StrainForce, which: int) -> float:
    """The E whose curve gives the same force at one point's strain."""
    strain, force = measured.strain[which], measured.force[which]
    forces = [float(c(strain)) for c in by_E.values()]
    x = np.array(list(by_E)) ** (-2 / 3)
    return float(np.interp(force, forces, x) ** -1.5)


def _spread(by_E: dict[float, StrainForce], by_d: list[StrainForce], by_h: list[StrainForce]) -> str:
    def share(curves: Sequence[StrainForce]) -> float:
        ends = [c.strain[-1] for c in curves]
        return float((max(ends) - min(ends)) / np.mean(ends))

    return (
        f"strain at F = 1 varies by {100 * share(list(by_E.values())):.0f} % with E, "
        f"{100 * share(by_d):.0f} % with d, {100 * share(by_h):.0f} % with h"
    )


def _measured(weights: Sequence[Path], thickness_mm: float) -> Item:
    if not weights:
        why = (
            "Needs measured tables (force, displacement in mm), one CSV file for each rubber lump: --weights "
            "FILE."
        )
        return Item("Figure 21", missing=why)
    found = measure(weights=weights, thickness_mm=thickness_mm).curves
    beside = [
        Beside(
            one.label,
            "soft and hard lumps apart",
            f"like E = {placed.E_ratio:.1f} ({one.text()}, R2 {one.r2:.3f})",
        )
        for one, placed in found
    ]
    caption = (
        f"Measured force against strain (displacement over {thickness_mm:g} mm), placed among the simulated "
        "curves; the softest of them sets the scale of the force."
    )
    return Item("Figure 21", caption, beside, lambda: figure_21([one for one, _ in found]))


def figure_15(curves: Sequence[StrainForce], nonlinear: StrainForce) -> Figure:
    """Linear stiffnesses, and the nonlinear lump over them."""
    figure = style.new(8.8, 3.8)
    left, right = figure.subplots(1, 2, sharey=True)
    _draw(left, curves, "different E")
    for one in curves:
        s = np.linspace(0, one.strain.max(), 60)
        right.plot(s, one(s), color="#b8c4cd", lw=1)
    right.plot(nonlinear.strain, nonlinear.force, "o-", color=style.ORANGE, label="nonlinear lump")
    right.set(xlabel="nominal strain over the lump")
    right.set_title("and a lump that stiffens")
    right.legend()
    return figure


def figure_16(by_d: Sequence[StrainForce], by_h: Sequence[StrainForce]) -> Figure:
    """Different diameters, different depths."""
    figure = style.new(8.8, 3.8)
    left, right = figure.subplots(1, 2, sharey=True)
    _draw(left, by_d, "different d")
    _draw(right, by_h, "different h")
    return figure


def figure_21(curves: Sequence[StrainForce]) -> Figure:
    """Measured curves."""
    figure = style.new(8.4, 4.4)
    ax = figure.subplots()
    _draw(ax, curves, "measured")
    ax.set_ylabel("force F (as measured)")
    return figure


def _draw(ax: Axes, curves: Sequence[StrainForce], title: str) -> None:
    for one in curves:
        s = np.linspace(0, one.strain.max(), 60)
        line = ax.plot(s, one(s), lw=1.2, label=style.powers(f"{one.label}: {one.text()}"))[0]
        ax.plot(one.strain, one.force, "o", color=line.get_color())
    ax.set(xlabel="nominal strain over the lump", ylabel="force F")
    ax.set_title(title)
    ax.locator_params(axis="x", nbins=6)
    ax.legend()

"""Figures 3 and 4: the way from input parameters to output parameters and back, and the breast in section."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Polygon

from palpate.report import style
from palpate.report.items import Beside, Item

_BOXES = (
    (0.02, "input parameters", "force F, fat t,\ndiameter d, depth h,\nstiffness E"),
    (0.27, "finite elements", "press, stroke:\ndeformed tissue,\ncontact pressure"),
    (0.52, "tactile images and map", "16 x 26 pressures at\nevery 2 mm; Method 2;\nprobe displacement"),
    (0.77, "output parameters", "Base, Amp, Stdev,\nCurvature, displacement\nat 28 mm and at 0"),
)
_WIDTH = 0.2


def items() -> list[Item]:
    """Both; they need no data."""
    return [
        Item(
            "Figure 3",
            "Design Flow of the Project",
            "Finite elements are pressed and stroked, features extracted from their tactile images. The "
            "forward model predicts the features from the inputs; the inverse model, fitted to the same "
            "runs, gives the inputs back from the features that a probe can measure.",
            [
                Beside(
                    "forward model", "equations fitted to 29 simulations", "Figures 13 and 17, Appendix B"
                ),
                Beside("inverse model", "the heart of the project", "Figures 18 and 19, Table 1, Appendix C"),
            ],
            figure_3,
        ),
        Item(
            "Figure 4",
            "Breast Anatomy - Three Layers of Breast Tissue",
            "A sketch, not to scale. Tumours often form in the gland, and become palpable when they "
            "penetrate into the fat. Figure 5 is what the simulations make of it.",
            [
                Beside("uppermost", "a thick layer of fat", "fat"),
                Beside("beneath", "stiffer, normal glandular tissue", "gland"),
                Beside(
                    "deepest", "chest wall: muscle and bone", "muscle and ribs; fixed, in the simulations"
                ),
            ],
            figure_4,
        ),
    ]


def figure_3() -> Figure:
    """Boxes from left to right, the forward model over them, the inverse model back below."""
    figure = style.new(9.2, 2.9)
    ax = figure.subplots()
    _bare(ax)
    for x, head, text in _BOXES:
        ax.add_patch(
            FancyBboxPatch(
                (x, 0.33), _WIDTH, 0.36, boxstyle="round,pad=0.008", fc="#eef3f7", ec=style.SOFT, lw=1
            )
        )
        ax.text(x + _WIDTH / 2, 0.62, head, ha="center", va="center", weight="bold", fontsize=9)
        ax.text(x + _WIDTH / 2, 0.46, text, ha="center", va="center", fontsize=8)
    steps = ("simulate", "put together", "extract")
    for (x, *_), word in zip(_BOXES, steps):
        _arrow(ax, (x + _WIDTH + 0.01, 0.51), (x + 0.25 - 0.01, 0.51), style.INK)
        ax.text(x + _WIDTH + 0.025, 0.74, word, ha="center", fontsize=8, color=style.SOFT)
    first, last = _BOXES[0][0] + _WIDTH / 2, _BOXES[-1][0] + _WIDTH / 2
    for y, ends, word, color in (
        (0.86, (first, last), "Forward Model: equations from inputs to outputs", style.BLUE),
        (0.14, (last, first), "Inverse Model: equations from outputs to inputs", style.ORANGE),
    ):
        edge = 0.71 if y > 0.5 else 0.31
        ax.plot([ends[0], ends[0], ends[1]], [edge, y, y], color=color, lw=1.8)
        _arrow(ax, (ends[1], y), (ends[1], edge), color)
        ax.text(0.5, y + (0.05 if y > 0.5 else -0.1), word, ha="center", color=color, weight="bold")
    return figure


def figure_4() -> Figure:
    """Skin, fat, gland with lobes, muscle and ribs, a tumour on the border, and the probe above."""
    figure = style.new(8.4, 4.4)
    ax = figure.subplots()
    x = np.linspace(-60, 60, 241)
    bow = np.exp(-((x / 34) ** 2))
    skin, border, muscle = 6 + 26 * bow, 1 + 13 * bow + 0.9 * np.sin(x / 3.1) * bow, np.full_like(x, -3.0)
    for low, high, color in (
        (border, skin, style.FAT),
        (muscle, np.maximum(border, muscle + 0.6), style.GLAND),
        (muscle - 5, muscle, "#b86f62"),
        (np.full_like(x, -17.0), muscle - 5, style.WALL),
    ):
        ax.fill_between(x, low, high, fc=color, ec="none")
    ax.plot(x, skin, color="#b98b5e", lw=2.5)
    for at in (-44.0, -14.0, 16.0, 46.0):
        ax.add_patch(
            FancyBboxPatch((at - 5, -14), 10, 3.2, boxstyle="round,pad=1.2", fc="#efe7d6", ec="none")
        )
    for at, size in ((-14.0, 2.4), (-6.5, 3.0), (2.5, 3.0), (10.5, 2.6), (-2.0, 2.6), (6.5, 2.3)):
        y = 3.2 if at in (-2.0, 6.5) else 6.2
        ax.add_patch(Circle((at, y), size, fc="#d98c7c", ec="none"))
    lump = (-15.0, float(np.interp(-15.0, x, border)))
    ax.add_patch(Circle(lump, 3.6, fc=style.LUMP, ec="white", lw=1))
    _probe(ax, x, skin)
    for text, place, target in (
        ("skin", (34, 38), (20, float(np.interp(20, x, skin)))),
        ("fat", (34, 33), (16, 20)),
        ("normal glandular tissue", (34, 28), (12, 7.5)),
        ("chest wall: muscle", (-58, -6.2), None),
        ("and bone", (-34.5, -12.4), None),
        ("tumour", (-58, 27), (lump[0] - 2.5, lump[1] + 2.5)),
        ("tactile probe", (-58, 40), (-21, 37.5)),
    ):
        arrow = {"arrowstyle": "-", "color": style.SOFT, "lw": 0.8} if target else None
        color = "white" if text.startswith(("chest", "and")) else style.INK
        ax.annotate(text, target or place, place, arrowprops=arrow, va="center", color=color)
    ax.set(xlim=(-60, 60), ylim=(-17, 44), aspect="equal")
    ax.axis("off")
    return figure


def _probe(ax: Axes, x: np.ndarray, skin: np.ndarray) -> None:
    """A block that stands on the skin over the tumour, square to it."""
    at = -14.0
    slope = float(np.interp(at + 1, x, skin) - np.interp(at - 1, x, skin)) / 2
    along = np.array([1.0, slope]) / np.hypot(1.0, slope)
    up = np.array([-along[1], along[0]])
    s = np.linspace(-9, 9, 41)
    middle = np.array([at, float(np.interp(at, x, skin)) - 0.8])
    face = middle + np.outer(s, along) + np.outer(0.012 * s**2, up)
    ax.add_patch(
        Polygon(
            np.vstack((face, middle + 7 * along + 13 * up, middle - 7 * along + 13 * up)),
            fc="#c9d4dc",
            ec=style.SOFT,
        )
    )


def _arrow(ax: Axes, start: tuple[float, float], end: tuple[float, float], color: str) -> None:
    arrow = {"arrowstyle": "-|>", "color": color, "lw": 1.8, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", end, start, arrowprops=arrow)


def _bare(ax: Axes) -> None:
    ax.set(xlim=(0, 1), ylim=(0, 1))
    ax.axis("off")

"""The figures of docs/accuracy.md, from its own tables and a few presses: `python docs/draw_accuracy.py`.

Nothing is fitted: what a table of the page says is drawn, so that figure and table cannot differ.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.regression.balls.lumps import read_lumps
from palpate.report import style
from palpate.sim.tissue import Case, load_curve, simulate

PAGE = Path(__file__).parent / "accuracy.md"
FIGURES = Path(__file__).parent / "figures"
SET = Path("tests/sim/tissue/data")
FATS_KPA = (5.0, 10.0, 25.0)
PRESSES = (0.25, 0.5, 1.0)
PERCENT_OF = ("d", "depth", "t", "E_fat", "F")

Rows = dict[str, dict[str, str]]


def tables(page: str) -> list[Rows]:
    """Every table of a page: first cell of a row -> head -> cell."""
    out = []
    for text in re.findall(r"(?m)(?:^\|.*\|\n)+", page):
        heads, _, *rows = ([c.strip() for c in line.strip("|").split("|")] for line in text.splitlines())
        out.append({row[0]: dict(zip(heads, row)) for row in rows})
    return out


def table_with(found: Sequence[Rows], row: str, head: str) -> Rows:
    """The first table with such a row and such a head."""
    for rows in found:
        if head in rows.get(row, {}):
            return rows
    raise SystemExit(f"docs/accuracy.md has no table with a row {row!r} and a column {head!r}")


def number(cell: str) -> float:
    """The first number of a cell: "6.2" of "6.2 %"."""
    return float(re.findall(r"-?\d+(?:\.\d+)?", cell)[0])


def percent(cell: str) -> float:
    """The number before the per cent sign: 6.2 of "0.919 / 6.2 % / 90"."""
    return float(re.findall(r"([\d.]+) %", cell)[0])


def tissue(found: Sequence[Rows]) -> Figure:
    """What tells the tissue, how well the lump is told in it, and what the intervals cover."""
    figure = style.new(9.6, 6.4)
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=(1, 1.25))[:, 0]
    width, share, errors = above.subplots(1, 3, width_ratios=(1, 1, 1.3))
    _presses(width, share)
    held_out = table_with(found, "typical, with its press", "E_fat")
    _bars(
        errors,
        PERCENT_OF[:4],
        {"with its press": "typical, with its press", "the stroke alone": "typical, the stroke alone"},
        lambda row, name: percent(held_out[row][name]),
    )
    for k, name in enumerate(PERCENT_OF[:4]):
        wanted = percent(held_out["wanted"][name])
        errors.plot(
            [k - 0.42, k + 0.42], 2 * [wanted], color=style.INK, lw=1.5, label="wanted" if not k else None
        )
    errors.set(ylabel="median error (%)", title="the lump, in such tissue")
    errors.legend(fontsize=7)
    _coverage(below.subplots(), table_with(found, "d, quarter 1", "ln d"))
    return figure


def _presses(width: Axes, share: Axes) -> None:
    """Image width and centre share against the force, relative to the whole force, on fats of 5 to 25 kPa."""
    for fat, color in zip(FATS_KPA, style.ramp(len(FATS_KPA))):
        case = Case.without_lump(13.0, 0.8, fat_kPa=fat)
        strokes = load_curve(case, [0.8 * part for part in PRESSES])
        places = strokes[0].sensors_mm
        images = np.array([stroke.images_kPa[0] for stroke in strokes])
        rms = np.sqrt((images * places**2).sum(1) / images.sum(1))
        middle = images[:, 7:9].mean(1) / images.mean(1)
        for ax, values in ((width, rms), (share, middle)):
            ax.plot([80 * part for part in PRESSES], values, "o-", color=color, label=f"fat {fat:g} kPa")
    width.set(xlabel="force (N/m)", ylabel="mm", title="image's rms half width")
    share.set(xlabel="force (N/m)", title="centre over mean pressure")
    width.legend()


def _bars(ax: Axes, names: Sequence[str], rows: dict[str, str], value: Callable[[str, str], float]) -> None:
    """A group of bars for each name, a bar for each row."""
    wide = 0.8 / len(rows)
    for j, (words, row) in enumerate(rows.items()):
        at = np.arange(len(names)) + (j - (len(rows) - 1) / 2) * wide
        ax.bar(at, [value(row, name) for name in names], 0.92 * wide, color=style.COLORS[j], label=words)
    ax.set_xticks(range(len(names)), names)
    ax.grid(visible=False, axis="x")


def _coverage(ax: Axes, rows: Rows) -> None:
    outputs = ("ln F", "ln t", "ln d", "ln h", "E^-2/3", "ln E_fat")
    names = [name for name in rows if name != "all"]
    ax.axhspan(88, 92, color="#e6ebef", zorder=0)
    ax.axhline(86, color=style.INK, lw=1, ls="--", label="86, wanted")
    for j, output in enumerate(outputs):
        at = np.arange(len(names)) + 0.1 * (j - 2.5)
        values = [number(rows[name][output]) for name in names]
        ax.plot(at, values, "o", ms=3, color=(*style.COLORS, style.INK)[j], label=style.powers(output))
    ax.set_xticks(range(len(names)), [name.rpartition(" ")[2] for name in names])
    for k in range(0, len(names), 4):
        word = style.powers(names[k].partition(",")[0])
        ax.text(k + 1.5, 78.3, word, ha="center", fontsize=8)
        ax.axvline(k - 0.5, color=style.SOFT, lw=0.6)
    ax.set(xlim=(-0.5, len(names) - 0.5), ylim=(77, 98), title="coverage by quarter of lump and tissue")
    ax.set(xlabel="quarter, from the smallest values", ylabel="inside the 90 % interval (%)")
    style.beside(ax)


def place(found: Sequence[Rows]) -> Figure:
    """Errors by place; estimates beside what the map allows; where lumps are said to lie."""
    figure = style.new(9.6, 3.3)
    by_place, bound, said = figure.subplots(1, 3, width_ratios=(1, 1, 1.15))
    rows = table_with(found, "in the gland", "ln depth")
    where = ("in the fat", "at the border", "in the gland")
    _bars(
        by_place, [w.split()[-1] for w in where], {"d": "ln d", "depth": "ln depth", "t": "ln t"},
        lambda row, name: percent(next(rows[w] for w in where if w.endswith(name))[row]),
    )  # fmt: skip
    by_place.set(ylabel="median error (%)", title="by the lump's place")
    by_place.legend()
    limits = table_with(found, "bound of the map", "d")
    _bars(
        bound, PERCENT_OF[:4], {name: name for name in ("estimates", "bound of the map")},
        lambda row, name: number(limits[row][name]),
    )  # fmt: skip
    bound.set(ylabel="median error (%), 24 lumps", title="what the map allows")
    bound.legend()
    told = table_with(found, "in the fat", "unsure")
    heads = (*where, "unsure")
    left = np.zeros(3)
    for head, color in zip(heads, (style.FAT, "#cf9a6b", style.GLAND, "#dfe4e8")):
        values = np.array([number(told[w][head]) for w in where])
        said.barh(range(3), values, left=left, color=color, label=head, edgecolor="white")
        left += values
    said.set_yticks(range(3), where)
    said.invert_yaxis()
    said.set(xlabel="lumps said to lie (%)", title="where they lie, and are said to")
    said.legend(ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.2))
    said.grid(visible=False)
    return figure


def noise(found: Sequence[Rows]) -> Figure:
    """Errors at two levels of noise; two lumps, or undulating tissue, before and after the checks."""
    figure = style.new(9.6, 3.2)
    levels, pairs = figure.subplots(1, 2)
    held_out = table_with(found, "typical, with its press", "E_fat")
    names = [
        f"{level}, {kind}" for level in ("typical", "real") for kind in ("with its press", "the stroke alone")
    ]
    _bars(levels, PERCENT_OF, {name: name for name in names}, lambda row, name: percent(held_out[row][name]))
    levels.set(ylabel="median error (%)", title="lumps that were found, at two levels of noise")
    levels.legend()
    rows = table_with(found, "two, 8 mm apart", "misses, no flag")
    words = [name for name in rows if not name.startswith("none")]
    short = ("two, ", " apart", " lump", "one, thickness undulates by ")
    labels = [functools.reduce(lambda word, part: word.replace(part, ""), short, name) for name in words]
    _bars(
        pairs, words,
        {"without the checks": "misses, no flag, without the checks", "with them": "misses, no flag"},
        lambda head, name: number(rows[name][head]),
    )  # fmt: skip
    pairs.set_xticks(range(len(words)), labels)
    pairs.set(ylabel="d silently wrong (%)", xlabel="distance of two lumps; how far the thickness undulates")
    pairs.set(title="two lumps side by side, or uneven tissue")
    pairs.legend()
    return figure


def balls(found: Sequence[Rows]) -> Figure:
    """A ball and a cylinder under the same force; errors beside the plane's and the limit; what is found."""
    figure = style.new(9.6, 5.6)
    above, below = figure.subfigures(2, 1, height_ratios=(1, 1))
    _ball_and_cylinder(*above.subplots(1, 3, width_ratios=(1, 1, 1.1)))
    errors, shares = below.subplots(1, 2, width_ratios=(1.5, 1))
    told = table_with(found, "typical, plane-strain model", "d")
    limits = table_with(found, "soft", "place across")
    rows = {
        "the model of cylinders": lambda name: percent(told["typical, plane-strain model"][name]),
        "the model of balls": lambda name: percent(told["typical, with its press"][name]),
        "what the images allow": lambda name: number(limits["all"][name]),
    }
    words = {word: word for word in rows}
    _bars(errors, PERCENT_OF[:4], words, lambda row, name: rows[row](name))
    errors.set(ylabel="median error (%)", yscale="log", ylim=(0.3, 400), title="over balls and ellipsoids")
    errors.legend(ncol=3, loc="upper center")
    _found(shares, table_with(found, "beside the line", "found"))
    return figure


def _ball_and_cylinder(ball: Axes, cylinder: Axes, dips: Axes) -> None:
    """Images over the clearest of the first lumps and over a cylinder like it; displacements on the way."""
    lump = max(read_lumps(SET)[:32], key=lambda one: float(np.ptp(one.strokes.low.images_kPa[-1])))
    stroke = lump.strokes.low
    same = ("d_mm", "h", "E_ratio", "F_rel", "gland_ratio", "gland_mm", "probe_radius_mm")
    stiffening = {n: getattr(stroke.case, n) for n in ("fat_stiffening", "gland_stiffening")}
    plane = simulate(Case(**{name: getattr(stroke.case, name) for name in same}, **stiffening))
    rows = plane.images_kPa[-1]
    images = (stroke.images_kPa[-1], np.repeat(rows[:, None], stroke.images_kPa.shape[2], axis=1))
    most = max(image.max() for image in images)
    for ax, image, words in zip((ball, cylinder), images, ("a ball", "a cylinder")):
        ax.imshow(image, extent=(-19.5, 19.5, -12, 12), vmin=0, vmax=most)
        ax.set(xlabel="across (mm)", title=f"{words} of {stroke.case.d_mm:.0f} mm")
        ax.grid(visible=False)
    ball.set(ylabel="along (mm)")
    for felt, words in ((stroke, "ball"), (plane, "cylinder")):
        dips.plot(felt.positions_mm, felt.displacement_mm, label=words)
    dips.set(xlabel="place of the probe (mm)", title="displacement (mm)", xlim=(-28, 0))
    dips.legend()


def _found(ax: Axes, rows: Rows) -> None:
    kinds = [(row, cells) for row, cells in rows.items() if row.startswith("d ")]
    shares = np.array([number(cells["found"]) for _, cells in kinds]).reshape(3, 3)
    ax.imshow(shares.T, vmin=40, vmax=150, cmap="Greens", origin="lower", aspect="auto")
    for k, (_, cells) in enumerate(kinds):
        ax.text(k // 3, k % 3, f"{cells['found']}\nd to {cells['d']}", ha="center", va="center", fontsize=8)
    ax.set_xticks(range(3), [kinds[3 * k][0].split(",")[0].removeprefix("d ") for k in range(3)])
    ax.set_yticks(range(3), [kinds[k][0].split(", h ")[1] for k in range(3)])
    ax.set(xlabel="d", ylabel="h", title="share found, and how well d is told")
    ax.grid(visible=False)


def main() -> None:
    """Draw all four."""
    found = tables(PAGE.read_text(encoding="utf-8"))
    with style.look():
        for name, draw in (("tissue", tissue), ("place", place), ("noise", noise), ("balls", balls)):
            path = FIGURES / f"accuracy-{name}.svg"
            draw(found).savefig(path, metadata={"Date": None})
            print(f"wrote {path.name}")


if __name__ == "__main__":
    main()

"""The figure of docs/accuracy.md, from the recipes of the models: `python docs/draw_accuracy.py`.

`python docs/fill_accuracy.py` draws it too. Its metadata hold the hash of every model's file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.models import NAMES, recipe
from palpate.report import style

FIGURE = Path(__file__).parent / "figures" / "accuracy.svg"
QUANTITIES = {"d": "diameter", "depth": "depth", "t": "thickness t", "E_fat": "fat's modulus"}
SETTINGS = {"typical, with its press": "typical noise", "real, with its press": "real noise"}
TOLD = ("balls", "field", "anywhere")
"""Those with both levels of noise in their scores."""


def figure() -> Figure:
    """Median errors at two levels of noise; coverage by quarter, as a map."""
    drawn = style.new(9.6, 7.2)
    above, below = drawn.subfigures(2, 1, height_ratios=(1, 1.9))
    for ax, name in zip(above.subplots(1, 3, sharey=True), TOLD):
        _errors(ax, name)
    axes = below.subplots(1, 3)
    for ax, name in zip(axes, TOLD):
        image = _coverage(ax, name)
    below.colorbar(image, ax=list(axes), label="90 % intervals that hold (%)", shrink=0.8)
    return drawn


def _errors(ax: Axes, name: str) -> None:
    rows = {row["setting"]: row for row in recipe(name)["scores"]["held_out"]}
    for k, (setting, words) in enumerate(SETTINGS.items()):
        heights = [100 * rows[setting][f"{key}_error"] for key in QUANTITIES]
        ax.bar(np.arange(len(heights)) + 0.4 * k - 0.2, heights, 0.38, color=style.COLORS[k], label=words)
    ax.set_xticks(range(len(QUANTITIES)), [words.replace(" ", "\n") for words in QUANTITIES.values()])
    ax.set(title=name)
    ax.grid(visible=False, axis="x")
    if name == TOLD[0]:
        ax.set_ylabel("median error (%)")
        ax.legend()


def _coverage(ax: Axes, name: str):  # type: ignore[no-untyped-def]
    rows = [row for row in recipe(name)["scores"]["coverage"] if "quarter" in row["group"]]
    outputs = [key for key in rows[0] if key not in ("group", "n")]
    values = 100 * np.array([[row[key] for key in outputs] for row in rows])
    image = ax.imshow(values, vmin=78, vmax=98, cmap="RdYlBu", aspect="auto")
    ax.set_xticks(range(len(outputs)), [_label(key.removeprefix("ln ")) for key in outputs], rotation=90)
    groups = [row["group"].partition(",")[0] for row in rows[::4]]
    ax.set_yticks(np.arange(len(groups)) * 4 + 1.5, [_label(group) for group in groups])
    for line in range(4, len(rows), 4):
        ax.axhline(line - 0.5, color="white", lw=1.5)
    ax.set(title=f"{name}: least {values.min():.0f} %")
    ax.grid(visible=False)
    return image


def _label(name: str) -> str:
    return {"E_fat": "fat's modulus", "gland_mm": "gland depth"}.get(
        name, style.powers(name.replace("_", " "))
    )


def hashes() -> str:
    """The hash of every model's file, as the figure's metadata have it."""
    return " ".join(f"{name}:{recipe(name)['sha256']}" for name in NAMES)


def main() -> None:
    """Draw it."""
    with style.look():
        figure().savefig(FIGURE, metadata={"Date": None, "Description": hashes()})
    print(f"wrote {FIGURE.name}")


if __name__ == "__main__":
    main()

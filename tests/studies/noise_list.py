"""What an audit found missing from the noise that models are trained with, each item run by itself.

The bundled model answers strokes over lumps and plain tissue that no model has met, computed at five forces:
sensors that err together, cells that hang, tissue that undulates, strokes that end too soon, whose force
changes, or that have few frames. Through the probe's integers up to the features, in float64 from there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from firmware_py import status
from palpate import models
from palpate.errors import UsageError
from palpate.features.map_features import Floats
from palpate.firmware_twin.replay_core import Replay
from palpate.learn.data import sweep_progress
from palpate.learn.lumps import LumpStrokes, read_presses, scaled
from palpate.learn.model import depth_mm
from palpate.learn.observed import NAMES, random_scale
from palpate.learn.probe_model import OUTPUTS, shows_lump
from palpate.model_export.fixed_point import force_map as force_maps
from palpate.model_export.fixed_point import reference
from palpate.model_export.schema import ModelSpec
from palpate.progress import ProgressCallback
from palpate.sim.probe.noise import LEVELS, Noise
from palpate.sim.probe.packed_frames import FrameStream
from palpate.sim.probe.sensors import PRESS_FRAMES, SensorModel, StrokeField
from palpate.sim.tissue import Settings, sweep
from palpate.sim.tissue.any_tissue import PRESSES, STROKES, TissueRanges, at_forces, plain_lumps, random_lumps
from tests.studies.table import Asked, StudyTable

SEED, PLAIN_SEED, DRAWS = 47, 48, 2
LUMPS, PLAIN = 200, 60
FORCE_PARTS = (0.55, 0.75, 1.0, 1.25, 1.5)
"""Forces of each lump's strokes, over the middle one: room for a hand that goes 40 % up and down."""

PRESS_PARTS = (0.2, 0.4, 0.65, 1.0, 1.45)
_STILL = Settings(start_mm=0.0)
_HALF_TRAVEL_MM = 40.0
_FAT = OUTPUTS.index("ln E_fat")

Step = Callable[[str], None]


class Hand(SensorModel):
    """A hand whose force may rise evenly along the stroke, by `rise` of its mean to either side."""

    rise: float | None = None

    def force_at(self, stroke_mm: Floats) -> Floats:
        """N/m, at places along the stroke."""
        if self.rise is None:
            return super().force_at(stroke_mm)
        share = 2 * np.asarray(stroke_mm, float) / self.travel_mm
        return np.asarray(self.mean_force_N_per_m * (1 + self.rise * share))


@dataclass(frozen=True)
class Item:
    """One thing that is wrong with a stroke, its sensors or its tissue.

    Attributes
    ----------
    words : str
    noise : Noise
    frames : int
        Of the stroke, in 80 mm.
    past_mm : float
        Where it ends, from the lump.
    rise : float, optional
        Of the force, to either side.
    plain : bool
        Whether it is tried on tissue without a lump, too.
    """

    words: str
    noise: Noise
    frames: int = 50
    past_mm: float = _HALF_TRAVEL_MM
    rise: float | None = None
    plain: bool = False


_TYPICAL = LEVELS["typical"]
_MIDDLE = _TYPICAL.with_(start_mm=0.0)

ITEMS = (
    Item("typical", _TYPICAL, plain=True),
    Item("real", LEVELS["real"], plain=True),
    *(
        Item(
            f"typical, {100 * share:g} % of the cells hang anywhere", _TYPICAL.with_(stuck=share), plain=True
        )
        for share in (0.005, 0.01, 0.02)
    ),
    Item("typical, gain of all cells right", _TYPICAL.without("common_gain")),
    Item("typical, gain of all cells +-4 %", _TYPICAL.with_(common_gain=0.04)),
    Item("typical, hysteresis of 1 %", _TYPICAL.with_(hysteresis=0.01)),
    *(
        Item(f"typical, thickness undulates by {100 * u:g} %", _TYPICAL.with_(undulation=u), plain=True)
        for u in (0.02, 0.05, 0.1)
    ),
    *(Item(f"ends {mm} mm past the lump", _MIDDLE, past_mm=mm) for mm in (15, 18, 21, 23, 25, 28, 32)),
    *(
        Item(f"force {'rises' if r > 0 else 'falls'} by {100 * abs(r):.0f} % to either side", _MIDDLE, rise=r)
        for r in (0.1, 0.15, 0.2, 0.25, 0.3, 0.4, -0.1, -0.2, -0.3, -0.4)
    ),
    *(Item(f"{n} frames in 80 mm", _TYPICAL, frames=n) for n in (16, 20, 22, 24, 28, 32, 40)),
)


def prepare(
    directory: Path,
    lumps: int = LUMPS,
    workers: int | None = None,
    progress: ProgressCallback | None = None,
) -> tuple[list[LumpStrokes], list[LumpStrokes]]:
    """Simulate into `directory` what it lacks, and read it: lumps, and plain tissue."""
    tissues = {
        "lumps": (random_lumps(lumps, SEED, TissueRanges()), STROKES),
        "plain": (plain_lumps(round(lumps * PLAIN / LUMPS), PLAIN_SEED), _STILL),
    }
    found = []
    for name, (cases, settings) in tissues.items():
        strokes, presses = directory / name, directory / f"{name}-press"
        report = sweep_progress(f"pressing, {name}", progress)
        sweep(at_forces(cases, PRESS_PARTS), PRESSES, presses, workers=workers, progress=report)
        report = sweep_progress(f"stroking, {name}", progress)
        sweep(at_forces(cases, FORCE_PARTS), settings, strokes, workers=workers, progress=report)
        found.append(_read(strokes, presses))
    return found[0], found[1]


def _read(strokes: Path, presses: Path) -> list[LumpStrokes]:
    """What two sweeps have, lump by lump."""
    by_lump = {replace(press[0].case, F_rel=1.0): press for press in read_presses(presses)}
    return [
        LumpStrokes(rising, by_lump[key])
        for rising in read_presses(strokes)
        if (key := replace(rising[0].case, F_rel=1.0)) in by_lump
    ]


@dataclass(frozen=True)
class Seen:
    """n strokes: codes (n), features (n, features), truths (n, 7), cells that hang and were mended (n, 2)."""

    codes: np.ndarray
    X: Floats
    Y: Floats
    cells: np.ndarray


def observe(lumps: Sequence[LumpStrokes], item: Item, spec: ModelSpec, seed: int) -> Seen:
    """One stroke with its press over each lump, each in a fat and by a probe and a hand of its own."""
    replay = Replay(None if spec.force_map is None else force_maps.blob(spec.force_map))
    codes, X, Y, cells = [], [], [], []
    for k, lump in enumerate(lumps):
        rng = np.random.default_rng([seed, k])
        s = random_scale(lump.case, rng)
        field = StrokeField(*(scaled(stroke, s) for stroke in lump.strokes))
        hand = Hand(field, item.noise, int(rng.integers(1 << 40)))
        hand.rise = item.rise
        pressed = StrokeField(*(scaled(press, s) for press in lump.press))
        whole = hand.stroke(item.frames, press=PRESS_FRAMES, pressed=pressed)
        stream, x = _cut(whole, item)
        codes.append(replay.stream(stream, hand.calibration()))
        X.append(replay.features())
        cells.append((int(hand.stuck.sum()), replay.pipeline.stuck))
        case = lump.case
        lengths = np.log([case.t_mm, case.d_mm, case.h])
        fat = case.fat_kPa * s * float(hand.stiffness_at(x).mean())
        F = float(hand.force_at(x).mean())
        Y.append([np.log(F), *lengths, case.E_ratio ** (-2 / 3), np.log(fat), np.log(case.depth_mm)])
    return Seen(np.array(codes), np.array(X), np.array(Y), np.array(cells))


def _cut(stream: FrameStream, item: Item) -> tuple[FrameStream, Floats]:
    """The stroke up to `past_mm`, and where its frames are."""
    x = np.linspace(-_HALF_TRAVEL_MM, _HALF_TRAVEL_MM, item.frames)
    n = int(np.sum(x <= item.past_mm))
    end = stream.press + n
    cut = replace(
        stream,
        packed=stream.packed[:end],
        positions_um=stream.positions_um[:end],
        displacements_um=stream.displacements_um[:end],
    )
    return cut, x[:n]


SHOWN = ("F", "t", "d", "h", "E^-2/3", "E_fat", "depth")
"""The outputs, and the depth that follows from them."""


def row(seen: Seen, spec: ModelSpec) -> dict[str, Any]:
    """What becomes of strokes over lumps, as shares of all; coverage and d's error of those with an answer.

    `refused`: how many, by status; `flagged`: of those with an answer; `right`, `wrong`: d's interval holds,
    or misses, and no flag, of all strokes; `d_error`, `E_fat_error`: median, relative; `d_error_of_all`: the
    median where a stroke without an answer errs more than any other.
    """
    whole = (seen.codes == status.OK) | (seen.codes == status.NO_FIT)
    found = whole & (seen.codes == status.OK) & shows_lump(seen.X, NAMES)
    refused = Counter(int(code) for code in seen.codes[~whole])
    out: dict[str, Any] = {
        "strokes": len(seen.X),
        "refused": {status.TEXT[code]: n / len(seen.X) for code, n in sorted(refused.items())},
        "not_found": float((whole & ~found).mean()),
        "hanging": float(seen.cells[:, 0].mean()),
        "mended": float(seen.cells[:, 1].mean()),
        "n": int(found.sum()),
    }
    if not found.any():
        return out
    said = reference.evaluate(spec, reference.inputs(spec, seen.X[found]))
    inside, error = _held(spec, said, seen.Y[found])
    flagged = ~said["in_domain"]
    d = SHOWN.index("d")
    out |= {
        "flagged": float(flagged.mean()),
        "covered": dict(zip(SHOWN, inside.mean(0).tolist())),
        "covered_unflagged": dict(zip(SHOWN, inside[~flagged].mean(0).tolist())) if not flagged.all() else {},
        "d_error": float(np.median(error)),
        "d_error_of_all": _of_all(error, len(seen.X)),
        "E_fat_error": float(np.median(np.abs(np.expm1(said["y"][:, _FAT] - seen.Y[found][:, _FAT])))),
        "right": float((inside[:, d] & ~flagged).sum() / len(seen.X)),
        "wrong": float((~inside[:, d] & ~flagged).sum() / len(seen.X)),
    }
    return out


def _of_all(error: Floats, strokes: int) -> float:
    share = 0.5 * strokes / len(error)
    return float(np.quantile(error, share)) if share <= 1 else float("inf")


def _held(spec: ModelSpec, said: dict[str, Any], Y: Floats) -> tuple[np.ndarray, Floats]:
    """Whether the intervals hold (n, 7), and how far d is off, relative (n)."""
    y = said["y"]
    half = reference.half_widths(spec, y, said["sigma"])
    inside = np.abs(y - Y[:, : len(OUTPUTS)]) <= half
    _, low, high = depth_mm(y, half).T
    true = np.exp(Y[:, -1])
    d = OUTPUTS.index("ln d")
    error = np.abs(np.expm1(y[:, d] - Y[:, d]))
    return np.column_stack([inside, (low <= true) & (true <= high)]), error


def joined(parts: Sequence[Seen]) -> Seen:
    """Several draws as one."""
    return Seen(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("codes", "X", "Y", "cells"))
    )


def table_of(
    lumps: Sequence[LumpStrokes],
    plain: Sequence[LumpStrokes],
    items: Sequence[Item] = ITEMS,
    seed: int = 1,
    step: Step | None = None,
) -> list[dict[str, Any]]:
    """A row for each item: what becomes of strokes over lumps and, where it is asked, over plain tissue."""
    spec, out = models.load(), []
    for item in items:
        seen = joined([observe(lumps, item, spec, 1000 * seed + k) for k in range(DRAWS)])
        found = {"item": item.words, **row(seen, spec)}
        if item.plain:
            over = row(
                joined([observe(plain, item, spec, 1000 * seed + 500 + k) for k in range(DRAWS)]), spec
            )
            lump = over["n"] / over["strokes"]
            found |= {
                "plain_strokes": over["strokes"],
                "plain_lump": lump,
                "plain_not_flagged": lump * (1 - over.get("flagged", 0.0)),
            }
        out.append(found)
        if step:
            step(item.words)
    return out


def text_of(rows: Sequence[dict[str, Any]]) -> list[tuple[str, list[str], list[list[str]]]]:
    """Tables: title, heads, cells."""
    lumps, tissue = [], []
    for r in rows:
        covered = r.get("covered_unflagged", {})
        refused = ", ".join(f"{100 * share:.0f}" for share in r["refused"].values()) or "0"
        lumps.append(
            [
                r["item"],
                refused,
                f"{100 * r['not_found']:.0f}",
                f"{100 * r['flagged']:.0f}" if "flagged" in r else "",
                *(f"{100 * covered[name]:.0f}" if covered else "" for name in SHOWN),
                *(f"{100 * r[name]:.1f} %" if name in r else "" for name in ("d_error", "E_fat_error")),
                *(f"{100 * r[name]:.0f}" if name in r else "" for name in ("right", "wrong")),
                str(r["n"]),
            ]
        )
        if "plain_lump" in r:
            shares = (r["plain_lump"], r["plain_not_flagged"])
            tissue.append([r["item"], *(f"{100 * s:.1f}" for s in shares), str(r["plain_strokes"])])
    heads = [
        "stroke",
        "refused",
        "not found",
        "flagged",
        *SHOWN,
        "d off by",
        "E_fat off by",
        "d right",
        "d silently wrong",
        "n",
    ]
    return [
        ("Lumps, %: coverage of the 90 % intervals of those found and not flagged", heads, lumps),
        (
            "Plain tissue, %",
            ["stroke", "taken for a lump", "and not flagged", "strokes"],
            tissue,
        ),
    ]


def tables(asked: Asked) -> list[StudyTable]:
    """Strokes over lumps, and over plain tissue."""
    if asked.noise is not None:
        raise UsageError("noise-list names its noise itself: leave --noise out")
    lumps, plain = prepare(asked.directory, asked.lumps or LUMPS, progress=asked.progress)
    rows = table_of(lumps, plain, seed=asked.seed, step=asked.tell)
    numbers = pd.DataFrame(rows)
    return [StudyTable(*text, numbers) for text in text_of(rows)]

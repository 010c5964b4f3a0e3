"""A kept set of balls carried over to another mesh of which only some lumps have been computed anew.

python -m tests.studies.carried OLD.parquet NEW.parquet OUT.parquet [ANOTHER_OLD.parquet ITS_OUT.parquet]

What the two meshes' images differ by is smooth: it lies in the outermost columns, and depends on how the
face touches the tissue and on whether the lump reaches under that edge. So it is learnt, for either half of
the face, by ridge regression from the lumps that both sets hold. Lumps of NEW are kept as they are. The
recipe says which these are, and how well the others are carried.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.solid.kept import KeptStroke, read_kept, read_recipe, write_kept

Floats = NDArray[np.float64]

MIDDLE_ROWS = slice(6, 10)
HALF = 13
OUTER = 8
"""Columns whose reading says how the face's edge touches."""
NEAR_MM = 12.0
"""A lump that reaches further across has a mesh of its own under the face's edge."""
PENALTY = 10.0
FOLDS = 8


@dataclass(frozen=True)
class Halves:
    """Halves of images, outermost column first; a stroke's, then its press-in ramp's.

    Attributes
    ----------
    kPa : ndarray (n, 16, 13)
    mean_kPa, displacement_mm, reach_mm : ndarray (n,)
        Of the whole image; how far the lump reaches towards this side.
    lump : ndarray (n,)
    """

    kPa: Floats
    mean_kPa: Floats
    displacement_mm: Floats
    reach_mm: Floats
    lump: NDArray[np.intp]

    def take(self, which: NDArray[np.bool_]) -> Halves:
        """Some of them."""
        parts = (self.kPa, self.mean_kPa, self.displacement_mm, self.reach_mm, self.lump)
        return Halves(*(part[which] for part in parts))


def halves(strokes: Sequence[KeptStroke], lumps: Sequence[int]) -> Halves:
    """All left halves, then all right ones."""
    images = np.concatenate([part for s in strokes for part in (s.images_kPa, s.ramp_images_kPa)])
    depths = np.concatenate([part for s in strokes for part in (s.displacement_mm, s.ramp_displacement_mm)])
    counts = [len(s.images_kPa) + len(s.ramp_images_kPa) for s in strokes]
    across = np.repeat([s.case.half_axes_mm[1] for s in strokes], counts)
    offset = np.repeat([s.case.offset_mm for s in strokes], counts)
    return Halves(
        np.concatenate([images[:, :, :HALF], images[:, :, : HALF - 1 : -1]]),
        np.tile(images.mean((1, 2)), 2),
        np.tile(depths, 2),
        np.concatenate([across - offset, across + offset]),
        np.tile(np.repeat(np.asarray(lumps), counts), 2),
    )


@dataclass(frozen=True)
class Carrier:
    """Linear maps from features of an old half to the new one less the old over the old image's mean, and to
    the logarithm of the displacements' ratio."""

    centre: Floats
    scale: Floats
    weights: Floats

    def carried(self, old: Halves) -> tuple[Floats, Floats]:
        """What the new mesh would give: pressures (n, 16, 13), kPa, and displacements (n,), mm."""
        change = _standard(features(old), self.centre, self.scale) @ self.weights
        images = old.kPa + old.mean_kPa[:, None, None] * change[:, :-1].reshape(old.kPa.shape)
        ratio = np.exp(change[:, -1].reshape(2, -1).mean(0))
        return np.maximum(images, 0.0), old.displacement_mm * np.tile(ratio, 2)


def features(old: Halves) -> Floats:
    """Of each half: columns and rows over the mean, mean, displacement, the lump's reach, and products."""
    columns = old.kPa[:, MIDDLE_ROWS, :OUTER].mean(1) / old.mean_kPa[:, None]
    rows = old.kPa[:, [0, 2, -3, -1]].mean(2) / old.mean_kPa[:, None]
    beyond = np.maximum(old.reach_mm - NEAR_MM, 0.0)
    depth = old.displacement_mm
    plain = np.column_stack([columns, rows, np.log(old.mean_kPa), np.log(depth), depth, beyond, beyond > 0])
    main = plain[:, [0, 1, 2, 3, 8, -3, -2, -1]]
    upper = np.triu_indices(main.shape[1])
    return np.column_stack([plain, (main[:, :, None] * main[:, None, :])[:, upper[0], upper[1]]])


def learn(old: Halves, new: Halves) -> Carrier:
    """From halves of the same strokes on both meshes."""
    x = features(old)
    centre, scale = x.mean(0), x.std(0) + 1e-9
    x = _standard(x, centre, scale)
    change = (new.kPa - old.kPa) / old.mean_kPa[:, None, None]
    ratio = np.log(new.displacement_mm / old.displacement_mm)
    penalty = PENALTY * np.eye(x.shape[1])
    penalty[0, 0] = 0.0
    wanted = np.column_stack([change.reshape(len(x), -1), ratio])
    return Carrier(centre, scale, np.linalg.solve(x.T @ x + penalty, x.T @ wanted))


def errors(old: Halves, new: Halves) -> dict[str, float]:
    """Of lumps that the regression had not seen, before and after: rms of the outermost column and of the
    others over the image's mean, and of the displacement."""
    pressures, depths = np.empty_like(old.kPa), np.empty_like(old.displacement_mm)
    order = np.unique(old.lump, return_inverse=True)[1]
    for k in range(FOLDS):
        asked = order % FOLDS == k
        if asked.any():
            carrier = learn(old.take(~asked), new.take(~asked))
            pressures[asked], depths[asked] = carrier.carried(old.take(asked))
    out: dict[str, float] = {}
    for word, kPa, depth in (("before", old.kPa, old.displacement_mm), ("after", pressures, depths)):
        off = (kPa - new.kPa) / new.mean_kPa[:, None, None]
        out[f"edge_{word}"] = _rms(off[:, :, 0])
        out[f"rest_{word}"] = _rms(off[:, :, 1:])
        out[f"displacement_{word}"] = _rms(depth / new.displacement_mm - 1.0)
    return out


def carry(old: Path, new: Path, out: Path, *others: Path) -> dict[str, float]:
    """Write the whole set, and another by what the first one teaches; returns `errors`."""
    whole, some = read_kept(old), {stroke.case: stroke for stroke in read_kept(new)}
    groups = groupby(whole, key=lambda stroke: replace(stroke.case, F_rel=1.0))
    numbers = [k for k, (_, group) in enumerate(groups) for _ in group]
    both = [(s, some[s.case], k) for s, k in zip(whole, numbers, strict=True) if s.case in some]
    before, after, lumps = zip(*both, strict=True)
    of_old, of_new = halves(before, lumps), halves(after, lumps)
    carrier, found = learn(of_old, of_new), errors(of_old, of_new)
    told = {name: round(value, 5) for name, value in found.items()}
    sets = [
        (
            old,
            [some.get(stroke.case) or carried(stroke, carrier) for stroke in whole],
            out,
            sorted(set(lumps)),
        )
    ]
    for source, target in zip(others[::2], others[1::2], strict=True):
        sets.append((source, [carried(stroke, carrier) for stroke in read_kept(source)], target, []))
    for source, strokes, target, computed in sets:
        recipe = read_recipe(source)
        write_kept(
            strokes,
            target,
            {
                "design": recipe["design"],
                "settings": read_recipe(new)["settings"],
                "computed": computed,
                "carried": {"from": recipe["solver"], **told},
            },
        )
    return found


def carried(stroke: KeptStroke, carrier: Carrier) -> KeptStroke:
    """A stroke as the new mesh would give it."""
    both, depths = carrier.carried(halves([stroke], [0]))
    left, right = np.split(both, 2)
    images, n = np.concatenate([left, right[:, :, ::-1]], axis=2), len(stroke.images_kPa)
    return replace(
        stroke,
        images_kPa=images[:n],
        displacement_mm=depths[:n],
        ramp_images_kPa=images[n:],
        ramp_displacement_mm=depths[n : len(images)],
    )


def _standard(x: Floats, centre: Floats, scale: Floats) -> Floats:
    return np.column_stack([np.ones(len(x)), (x - centre) / scale])


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


if __name__ == "__main__":
    for name, value in carry(*map(Path, sys.argv[1:])).items():
        print(f"{name:20s} {value:.4f}")

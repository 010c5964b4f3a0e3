"""A reference press beside the lump: what it says of the tissue, joined to what the stroke's own press says.

The same first stage looks at both. What a reference says is ln F/E_fat at a force of its own, ln t and
ln(t + gland/ratio): with the stroke's force for its own the first is of the stroke too. The two are averaged,
each by how far it errs, unless they lie so far apart that the reference is of another place or person.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_py import reference as firmware_reference
from firmware_py import settings, status, stroke_state
from palpate.features import press_features
from palpate.features.map_features import Floats
from palpate.firmware_twin.replay_core import Replay
from palpate.learn.lumps import TISSUE_FIELDS, LumpStrokes, read_presses, scaled
from palpate.learn.model import said_by_press, tissue_truth
from palpate.learn.observed import NAMES, Observed, noise_named, probe_over
from palpate.learn.probe_model import Polynomial, fit_polynomial
from palpate.learn.scopes import BORDER
from palpate.model_export.schema import Joining as JoiningData
from palpate.model_export.vocabulary import ABSENT
from palpate.sim.probe.packed_frames import FrameStream
from palpate.sim.probe.sensors import Noise, StrokeField
from palpate.sim.tissue import Case, Stroke

BESIDE_MM = (30.0, 40.0)
"""Where the reference is pressed, from the lump."""

FORCE_PARTS = (0.9, 1.1)
"""Its force over the strokes': a hand does not press twice alike."""

FALSE_ALARMS = 0.02
"""Share of good references that are called of another place."""

_LN_FORCE = NAMES.index("ln_force")


@dataclass(frozen=True)
class References:
    """One reference for each of n strokes.

    press (n, 12): by `press_features.NAMES`, all `ABSENT` where the probe refused it; ln_force
    (n): of N/m.
    """

    press: Floats
    ln_force: Floats

    @property
    def taken(self) -> NDArray[np.bool_]:
        """(n), whether there is one."""
        return self.press[:, 0] != ABSENT

    def take(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> References:
        """Some of them: a mask (n), or indices."""
        return References(self.press[rows], self.ln_force[rows])

    @staticmethod
    def joined(parts: Sequence[References]) -> References:
        """Several as one."""
        return References(
            np.concatenate([p.press for p in parts]), np.concatenate([p.ln_force for p in parts])
        )


Tissue = tuple[object, ...]
"""What tells one tissue from another: its layers and the probe's face."""


def read_references(home: Path) -> dict[Tissue, tuple[Stroke, ...]]:
    """Presses beside lumps, or those of `press_cases`, which lie nearly as far from the lump."""
    return {tissue_of(press[0].case): press for press in read_presses(home)}


def tissue_of(case: Case) -> Tissue:
    """A case's tissue, whatever lump is in it."""
    return round(case.t_mm, 6), *(getattr(case, name) for name in TISSUE_FIELDS)


def features_of(stream: FrameStream, replay: Replay) -> tuple[int, Floats]:
    """What the probe makes of a reference's frames: status, and all features (those of the press count)."""
    p = replay.pipeline
    taking = firmware_reference.Taking(p)
    state = stroke_state.StrokeState(settings.Settings().values, sum(p.calibration.offset) >> 3)
    for packed, x, d in zip(stream.packed, stream.positions_um, stream.displacements_um, strict=True):
        code = taking.take_reference(packed, state.in_contact(packed), int(x), int(d))
        if code is not None:
            return int(code), replay.features()
    return status.NO_PRESS, replay.features()


def observe_references(
    lumps: Sequence[LumpStrokes],
    references: Mapping[Tissue, tuple[Stroke, ...]],
    noise: Noise | str,
    seed: int,
) -> References:
    """A reference beside each lump: the probe, the hand and the fat of `observe_in_any_fat` with this seed.

    None is taken where `references` has none of the lump's tissue.
    """
    level, replay = noise_named(noise), Replay()
    press, ln_force = np.full((len(lumps), len(press_features.NAMES)), ABSENT), np.zeros(len(lumps))
    for k, lump in enumerate(lumps):
        pressed = references.get(tissue_of(lump.case))
        if pressed is None:
            continue
        probe = probe_over(lump, level, seed, k)
        force = probe.sensors.mean_force_N_per_m * np.exp(probe.rng.uniform(*np.log(FORCE_PARTS)))
        place = probe.rng.choice([-1.0, 1.0]) * probe.rng.uniform(*BESIDE_MM)
        field = StrokeField(*(scaled(stroke, probe.scale) for stroke in pressed))
        replay.pipeline.calibration = probe.sensors.calibration()
        code, x = features_of(probe.sensors.reference(field, float(force), place_mm=float(place)), replay)
        if code == status.OK:
            press[k], ln_force[k] = x[press_features.PLACES], x[_LN_FORCE]
    return References(press, ln_force)


@dataclass(frozen=True)
class JoiningFit:
    """How a reference joins a stroke's own press (`firmware_py.stage.join`).

    Attributes
    ----------
    weights : (3,)
        Of the reference, 0 to 1; the press has the rest.
    triangle : (3, 3)
        Turns their differences into independent ones of spread 1.
    limit : float
        Greatest sum of the squares of those: beyond it the reference is of another place.
    """

    weights: Floats
    triangle: Floats
    limit: float

    def distance(self, own: Floats, reference: Floats) -> Floats:
        """Sum of squares, (n), of what press and reference say, (n, 3) each."""
        out: Floats = (((reference - own) @ self.triangle.T) ** 2).sum(1)
        return out

    def fits(self, own: Floats, reference: Floats) -> NDArray[np.bool_]:
        """(n), whether the reference may be of the same place."""
        return self.distance(own, reference) <= self.limit

    def joined(self, own: Floats, reference: Floats, always: bool = False) -> Floats:
        """(n, 3): the average, or the press alone where the reference does not fit (unless `always`)."""
        average = own + self.weights * (reference - own)
        return average if always else np.where(self.fits(own, reference)[:, None], average, own)

    def data(self) -> JoiningData:
        """As a model carries it."""
        rows = tuple(tuple(row[: i + 1].tolist()) for i, row in enumerate(self.triangle))
        return JoiningData(tuple(self.weights.tolist()), rows, self.limit)


def said_by(press: Polynomial, references: References, seen: Observed) -> Floats:
    """(n, 3): what the references say of the strokes' tissue, at the strokes' forces."""
    out = said_by_press(press, references.press)
    out[:, 0] += seen.X[:, _LN_FORCE] - references.ln_force
    return out


def fit_joining(
    own: Floats, reference: Floats, truth: Floats, false_alarms: float = FALSE_ALARMS
) -> JoiningFit:
    """Weights and distance from what presses and references say, (n, 3), of tissues new to the stage."""
    error, difference = own - truth, reference - own
    # that share of the difference which takes most of the error away
    weights = np.clip(-(error * difference).mean(0) / (difference**2).mean(0), 0.0, 1.0)
    spread = np.cov(_without_tails(difference), rowvar=False)
    triangle = np.linalg.inv(np.linalg.cholesky(spread))
    joining = JoiningFit(weights, triangle, 1.0)
    return replace(joining, limit=float(np.quantile(joining.distance(own, reference), 1 - false_alarms)))


def _without_tails(values: Floats) -> Floats:
    return np.clip(values, *np.quantile(values, [0.01, 0.99], axis=0))


def out_of_fold_pairs(train: Observed, references: References, terms_of: Polynomial) -> tuple[Floats, Floats]:
    """What press and reference say of each tissue by a stage that has not seen it, (n, 3) each."""
    T, X = tissue_truth(train), press_features.named(train.press, terms_of.names)
    fold = train.group % BORDER.folds
    own, other = np.zeros_like(T), np.zeros_like(T)
    for k in range(BORDER.folds):
        fit, test = fold != k, fold == k
        stage_ = fit_polynomial(
            terms_of.names, X[fit], T[fit], train.group[fit], terms_of.terms, T.min(0), T.max(0)
        )
        own[test] = stage_.predict(X[test])
        other[test] = said_by(stage_, references.take(test), train.take(test))
    return own, other


def learn_joining(
    press: Polynomial,
    seen: Observed,
    lumps: Sequence[LumpStrokes],
    references: Mapping[Tissue, tuple[Stroke, ...]],
    noise: str,
    seed: int,
) -> JoiningFit:
    """How a reference joins the press before one stroke over each lump, from tissues new to the stage.

    seen : strokes of `observe_in_any_fat` with this seed.
    """
    found = observe_references(lumps, references, noise, seed).take(seen.group)
    some, pressed = seen.take(found.taken), found.take(found.taken)
    own, other = out_of_fold_pairs(some, pressed, press)
    return fit_joining(own, other, tissue_truth(some))

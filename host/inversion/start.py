"""Where the search begins: the answer of a bundled regression, for lumps anywhere or for solid ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate import models
from palpate.firmware_twin.replay_core import Replay
from palpate.inversion.classes import GLAND, Class
from palpate.inversion.felt import FeltStroke
from palpate.model_export.integers import force_map, reference
from palpate.model_export.schema import ModelSpec
from palpate.sim.tissue.face_sensors import places_mm
from palpate.wire.cells import PITCH_MM

Floats = NDArray[np.float64]

_OUTPUTS = ("ln F", "ln t", "ln d", "ln h", "E^-2/3", "ln E_fat")
"""Those of the wire (`firmware_py.outputs`), as the model works with them."""

_SOFT, _HARD = 0.5, 0.12
_SIZE_BY_STIFFNESS = 0.97
"""Along ln d = const + this E^-2/3 images hardly change: a soft, large lump feels like a hard, small one."""

_BORDERS = ((1.0, 1.2), (1.0, 0.5), (0.75, 0.0))
"""Where the border may run: at such a share of the lump's depth and of its diameter."""
_MORE_BORDERS = (0.5, 0.0), (1.0, 2.0), (1.0, 3.5)
_STIFFNESSES, _AS_STIFF = (0.1, 0.3, 0.55), 0.08
_D_MM = 3.5, 30.0
_T_MM = 3.0, 45.0
_ELSEWHERE = 0.12
"""A border that is nearer to another one, as a logarithm, is the same."""
_ROOM = 1.4
"""A gland begins so much deeper than a lump in it reaches."""


@dataclass(frozen=True)
class Start:
    """A first estimate: lengths in mm, and where along the stroke the lump lies."""

    stroke: int
    d_mm: float
    depth_mm: float
    t_mm: float
    E_inv23: float
    E_kPa: float
    lump_mm: float

    def theta(self, of: Class) -> Floats:
        """The estimate as a first guess (k,) for a class."""
        known = {
            "ln d": np.log(self.d_mm), "ln depth": np.log(self.depth_mm), "ln t": np.log(self.t_mm),
            "E^-2/3": self.E_inv23,
        }  # fmt: skip
        mean = zip(of.unknowns, of.column("mean"))
        return _with_room(of, np.array([known.get(unknown.name, value) for unknown, value in mean]))

    def as_stiff(self, E_inv23: float) -> Start:
        """A lump of another stiffness that feels like it: a softer one is larger."""
        by = float(np.exp(_SIZE_BY_STIFFNESS * (E_inv23 - self.E_inv23)))
        return replace(self, d_mm=self.d_mm * by, E_inv23=E_inv23)

    def softer_and_harder(self, of: Class) -> Iterator[Floats]:
        """Further guesses (k,): lumps that feel like it."""
        for s in (_SOFT, _HARD):
            yield self.as_stiff(s).theta(of)

    def everywhere(self, of: Class) -> Iterator[Floats]:
        """Guesses (k,) of many kinds: soft and hard lumps that feel like it, under many a border."""
        for s in (self.E_inv23, *(s for s in _STIFFNESSES if abs(s - self.E_inv23) > _AS_STIFF)):
            like = self.as_stiff(s)
            d = float(np.clip(like.d_mm, *_D_MM))
            tried: list[float] = []
            for t in (self.t_mm, *(a * self.depth_mm + b * d for a, b in _BORDERS + _MORE_BORDERS)):
                t_mm = float(np.clip(t, *_T_MM))
                if all(abs(np.log(t_mm / other)) > _ELSEWHERE for other in tried):
                    tried.append(t_mm)
                    yield replace(like, d_mm=d, t_mm=t_mm).theta(of)


def with_other_borders(of: Class, theta: Floats) -> Iterator[Floats]:
    """A guess (k,) with its lump in the fat, across the border and in the gland, where it is not so yet.

    None where the class does not know where the border runs.
    """
    names = [unknown.name for unknown in of.unknowns]
    if not {"ln d", "ln t"} <= set(names):
        return
    at = names.index("ln t")
    d, depth = (float(np.exp(theta[names.index(name)])) for name in ("ln d", "ln depth"))
    tried = [theta[at]]
    for by_depth, by_d in _BORDERS:
        ln_t = float(np.log(np.clip(by_depth * depth + by_d * d, *_T_MM)))
        if all(abs(ln_t - other) > _ELSEWHERE for other in tried):
            tried.append(ln_t)
            moved = theta.copy()
            moved[at] = ln_t
            yield _with_room(of, moved)


def _with_room(of: Class, theta: Floats) -> Floats:
    """With a gland that the lump does not fill."""
    at = {unknown.name: k for k, unknown in enumerate(of.unknowns)}
    if {"ln d", "ln t"} <= set(at):
        d, depth, t = np.exp(theta[[at["ln d"], at["ln depth"], at["ln t"]]])
        theta[at[GLAND]] = max(theta[at[GLAND]], np.log(_ROOM * max(d + depth - t, 1.0)))
    return theta


MIDDLE = Start(0, 11.0, 6.0, 11.0, 0.3, 11.0, 0.0)
"""Of the lumps that models are trained for."""


def first_guess(felt: FeltStroke) -> Start:
    """Where no regression helps: the middle, its fat as stiff as the displacement says, the lump where the
    image says."""
    force = felt.rows_kPa.sum(1) * PITCH_MM
    E_kPa = MIDDLE.E_kPa
    most = int(force.argmax())
    if felt.measured and felt.displacement_mm[most] > 0.1:  # as `sim.tissue.run` guesses its depth
        E_kPa = (
            force[most] / 10 / (felt.displacement_mm[most] / 2.56 / (MIDDLE.t_mm / 13) ** 0.67) ** (1 / 0.62)
        )
    return replace(MIDDLE, stroke=felt.stroke, E_kPa=float(np.clip(E_kPa, 2, 60)), lump_mm=_bump_mm(felt))


def _bump_mm(felt: FeltStroke) -> float:
    """Where more is felt than usual: of a press beside the face's middle, of a stroke along its way."""
    at = places_mm(felt.rows_kPa.shape[1], PITCH_MM)
    if felt.alone:
        last = felt.rows_kPa[-1]
        return float(np.clip(3 * (last @ at) / last.sum(), -8.0, 8.0))
    rows = felt.rows_kPa[felt.press :] / felt.rows_kPa[felt.press :].mean(1, keepdims=True)
    more = rows - np.median(rows, axis=0)
    where = (felt.place_mm[felt.press :, None] + at).ravel()
    bins = np.arange(where.min(), where.max() + 2.0, 2.0)
    found = np.histogram(where, bins, weights=more.ravel())[0] / np.maximum(np.histogram(where, bins)[0], 1)
    low, high = np.sort(felt.place_mm[[felt.press, -1]])
    middle = (bins[1:] + bins[:-1]) / 2
    found[(middle < low) | (middle > high)] = -np.inf
    return float(middle[found.argmax()])


def agreed(starts: Sequence[Start]) -> Start:
    """What estimates of one lump say in the middle."""
    logs = np.log([[one.d_mm, one.depth_mm, one.t_mm, one.E_kPa] for one in starts])
    d, depth, t, E = np.exp(logs.mean(0)).tolist()
    stiffness = float(np.mean([one.E_inv23 for one in starts]))
    return replace(starts[0], d_mm=d, depth_mm=depth, t_mm=t, E_inv23=stiffness, E_kPa=E)


@lru_cache(maxsize=2)
def _model(name: str) -> tuple[ModelSpec, Replay]:
    spec = models.load(name)
    return spec, Replay(None if spec.force_map is None else force_map.blob(spec.force_map), plain=True)


Pressed = tuple[Sequence[bytes], Sequence[int]]
"""A press' packed frames, displacements in um."""
Stroked = tuple[Sequence[bytes], Sequence[int], Sequence[int]]
"""A stroke's packed frames, positions and displacements in um."""


def said_of(press: Pressed, frames: Stroked, calibration: object, model: str) -> tuple[dict[str, Any], float]:
    """What a bundled model says of a stroke, as `reference.evaluate`, and where its lump lies, mm.

    Nothing where it finds no lump.
    """
    spec, replay = _model(model)
    if replay.stroke(*frames, calibration, press) != 0:  # type: ignore[arg-type]
        return {}, 0.0
    said = reference.evaluate(spec, reference.inputs(spec, replay.features()[None]))
    return said, float(replay.results()["centre_mm"])


def start_of(
    stroke: int,
    press: Pressed,
    frames: Stroked,
    calibration: object,
    lump_mm: float,
    model: str = models.ANYWHERE,
) -> Start:
    """The regression's answer for a stroke; the middle of the design where it finds no lump.

    Parameters
    ----------
    calibration : firmware_py.calib.Calibration
    lump_mm : float
        Where the lump lies if the map does not say.
    model : str
        One of `palpate.models.NAMES`.
    """
    said, centre = said_of(press, frames, calibration, model)
    middle = replace(MIDDLE, stroke=stroke, lump_mm=lump_mm)
    if not said:
        return middle
    y = dict(zip(_OUTPUTS, said["y"][0]))
    values = [
        np.exp(y["ln d"]),
        np.exp(y["ln d"] + y["ln h"]),
        np.exp(y["ln t"]),
        y["E^-2/3"],
        np.exp(y["ln E_fat"]),
    ]
    if not np.isfinite(values).all():
        return middle
    d, depth, t, s, E = (float(v) for v in values)
    low, high = sorted((frames[1][0] / 1e3, frames[1][-1] / 1e3))
    centre = centre if low < centre < high else lump_mm
    return Start(
        stroke, float(np.clip(d, 4, 25)), float(np.clip(depth, 1.2, 40)), float(np.clip(t, *_T_MM)),
        float(np.clip(s, 0.02, 0.7)), float(np.clip(E, 2, 60)), centre,
    )  # fmt: skip

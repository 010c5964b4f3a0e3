"""How well a guess explains a stroke: the data's misfit, and what is known beforehand of sensors and hand.

The unknowns are those of the class, and everything between the skin and the count that the noise level names:

    rows  = (1 + gain) (P + 2 c (lagged P - P)) + offset + zero + drift share,    P = E / 10 kPa * image
    depth = displacement + zero + drift (2 share - 1)
    place = (1 + scale) (x - start) + its own error in each frame

The hand's force is unknown in every frame; in the stroke it wanders about a mean. A gain that all cells share
cannot be told from E: its spread is added to E's afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.answer.fitted import Laid
from palpate.inversion.classes import FAT_KPA, PADDING, Class
from palpate.inversion.felt import FeltStroke, Ints
from palpate.inversion.forward import Predicted, Slopes
from palpate.sim.probe.noise import Noise
from palpate.wire.cells import FULL_SCALE_KPA, PITCH_MM

Floats = NDArray[np.float64]

_COUNTS = 4095
_START_SD_MM = 15.0
_PRESS_SD_MM = 6.0
"""So far from the middle of the face may lie what a press alone is over."""
_PADDING_SD = 0.25
"""Of the logarithm of how far the padding gives way: its owner knows its modulus about so well."""
_LN_E, _LN_F = (np.log(10.8), 0.58), (np.log(5.46), 0.48)
"""Mean and spread of the fat's modulus in kPa and of the force over it in mm, over the models' design."""

_DEPTH_ERROR_MM = 0.002
_LEAST_SD = 1e-5

SINGLE = ("ln_E", "ln_F", "start", "scale", "creep", "zero", "drift", "depth_zero", "depth_drift")


class Wrong(NamedTuple):
    """What is wrong of computed frames: shares of the step from row to row, of pressure, of displacement."""

    of_step: float
    of_pressure: float
    of_depth: float = 0.0


USUAL_MESH, FINE_MESH = Wrong(0.05, 0.004), Wrong(0.015, 0.001)
EMULATED = Wrong(0.03, 0.005, 0.005)


@dataclass(frozen=True)
class Misfit:
    """Weighted residuals of the data, (n, rows + 1): rows, displacement; and of what is known beforehand."""

    data: Floats
    prior: Floats

    @property
    def total(self) -> float:
        """Twice the posterior's negative logarithm, but for a constant."""
        return float((self.data**2).sum() + (self.prior**2).sum())


class Posterior:
    """One stroke under one class; a guess is a vector z of all unknowns.

    Attributes
    ----------
    own_zeros : bool
        Whether each channel's own zero is among them.
    """

    own_zeros = True

    def __init__(self, of: Class, stroke: FeltStroke, noise: Noise, error: Wrong) -> None:
        self.of, self.stroke, self.noise = of, stroke, noise
        n, p, channels = len(stroke.displacement_mm), stroke.press, stroke.rows_kPa.shape[1]
        gains = self._gain_sd()
        self._gain_of = np.repeat(np.arange(len(gains)), channels // max(len(gains), 1))
        """Which of the gains a channel has; () where it has none."""
        sizes = {"tissue": len(of.unknowns), **dict.fromkeys(SINGLE, 1)}
        sizes |= {"gain": len(gains), "offset": channels if self.own_zeros else 0}
        sizes |= {"place": n - p, "force": n}
        ends = np.cumsum([0, *sizes.values()])
        self.at = {name: slice(int(a), int(b)) for name, a, b in zip(sizes, ends, ends[1:])}
        self.size = int(ends[-1])
        self.mean, self.sd = self._known()
        self.force_sd = max(0.5 * noise.force, 2e-3)
        self._lag = stroke.slow(np.eye(n))
        self.weigh(error)

    def weigh(self, error: Wrong) -> None:
        """Weigh the data by what is wrong of the frames that are held against them."""
        self._weight = self._weights(error)

    def _gain_sd(self) -> Floats:
        """Of each gain that is an unknown."""
        return np.sqrt(self.noise.gain**2 / self.stroke.live + self.noise.row_gain**2)

    def _gain(self, z: Floats) -> Floats:
        """What each channel reads more than it should, as a factor."""
        gains = 1 + z[self.at["gain"]]
        return gains[self._gain_of] if len(gains) else np.ones(self.stroke.rows_kPa.shape[1])

    def _known(self) -> tuple[Floats, Floats]:
        noise, live, p = self.noise, self.stroke.live, self.stroke.press
        zero = noise.drift * FULL_SCALE_KPA
        spread: dict[str, Any] = {
            "tissue": self.of.column("sd"),
            "ln_E": _LN_E[1],
            "ln_F": _LN_F[1],
            "start": _PRESS_SD_MM if self.stroke.alone else _START_SD_MM,
            "scale": noise.position_scale,
            "creep": noise.creep / 2,
            "zero": zero,
            "drift": 2 * zero,
            "depth_zero": noise.displacement_zero_mm,
            "depth_drift": noise.displacement_drift_mm,
            "place": noise.position_mm / np.sqrt(self.stroke.frames[p:]),
            "force": np.inf,
        }
        spread["gain"] = self._gain_sd()
        if self.own_zeros:
            spread["offset"] = noise.offset * FULL_SCALE_KPA / np.sqrt(live)
        mean, sd = np.zeros(self.size), np.empty(self.size)
        for name, value in spread.items():
            sd[self.at[name]] = np.maximum(value, _LEAST_SD)
        mean[self.at["tissue"]] = self.of.column("mean")
        mean[self.at["ln_E"]], mean[self.at["ln_F"]] = _LN_E[0], _LN_F[0]
        mean[self.at["creep"]] = noise.creep
        return mean, sd

    def _weights(self, error: Wrong) -> Floats:
        """One over the standard deviation of rows and displacement, (n, rows + 1); 0: not measured."""
        s, noise = self.stroke, self.noise
        white, depth = self._sensors(s.live)
        depth = np.hypot(depth, error.of_depth * s.displacement_mm)
        steps = np.abs(np.diff(np.pad(s.rows_kPa, ((0, 0), (1, 1)), mode="edge"), axis=1))
        step = error.of_step * np.maximum(steps[:, 1:], steps[:, :-1])
        mesh = np.hypot(step, error.of_pressure * np.maximum(s.rows_kPa, 0.0))
        stuck = noise.hysteresis * np.maximum(s.rows_kPa, 0.0)
        rows = np.sqrt(white**2 + mesh**2 + stuck**2 + s.curve_kPa**2)
        weight = 1.0 / np.column_stack([np.maximum(rows, 1e-3), depth])
        weight[:, -1] *= s.measured
        return weight

    def _sensors(self, live: Floats | Ints) -> tuple[Floats, Floats]:
        """Standard deviations (n, rows) of white noise in means of live cells, and (n,) in displacements."""
        noise, count, less = self.noise, FULL_SCALE_KPA / _COUNTS, 1 / np.sqrt(self.stroke.frames)
        white = np.hypot(noise.white * FULL_SCALE_KPA, count / np.sqrt(12)) / np.sqrt(live)
        return less[:, None] * white, np.hypot(noise.displacement_noise_mm * less, _DEPTH_ERROR_MM)

    def start(self, theta: Floats, E_kPa: float, lump_mm: float) -> Floats:
        """A first guess: tissue and lump (k,), the fat's modulus, where along the stroke the lump lies."""
        z = self.mean.copy()
        z[self.at["tissue"]] = self.of.within(theta)
        z[self.at["ln_E"]], z[self.at["start"]] = np.log(E_kPa), lump_mm
        middle = lump_mm if self.stroke.alone else self.stroke.place_mm[self.stroke.press :].mean()
        self.mean[self.at["start"]] = middle
        force = np.log(np.maximum(self.felt_N_per_m(), 1.0) / E_kPa)
        z[self.at["force"]] = force
        z[self.at["ln_F"]] = force.max() if self.stroke.alone else force[self.stroke.press :].mean()
        return z

    def felt_N_per_m(self) -> Floats:
        """What the rows add up to, frame by frame."""
        force: Floats = self.stroke.rows_kPa.sum(1) * PITCH_MM
        return force

    @property
    def measured(self) -> int:
        """How many numbers were."""
        return int(np.count_nonzero(self._weight))

    def force_at(self, z: Floats) -> int:
        """Which unknown the force is: the stroke's mean, or a press' greatest."""
        force = self.at["force"]
        return force.start + int(np.argmax(z[force])) if self.stroke.alone else int(self.at["ln_F"].start)

    def one(self, z: Floats, name: str) -> float:
        """One of `SINGLE`."""
        return float(z[self.at[name]][0])

    def places(self, z: Floats) -> Floats:
        """Of all frames, from the lump, mm (n,)."""
        p = self.stroke.press
        moved = (self.stroke.place_mm[p:] - z[self.at["place"]]) / (1 + self.one(z, "scale"))
        moved = moved - self.one(z, "start")
        return np.concatenate([np.full(p, -self.one(z, "start") if self.stroke.alone else moved[0]), moved])

    def forces(self, z: Floats) -> Floats:
        """Of all frames in fat of 10 kPa, N/m (n,)."""
        return FAT_KPA * np.exp(z[self.at["force"]])

    def predicted(self, z: Floats, found: Predicted) -> Floats:
        """Channels and displacement as these sensors would have read them, (n, channels + 1)."""
        share = self.stroke.share[:, None]
        rows = self._gain(z) * (self._lagged(z) @ self._pressure(z, found))
        if self.own_zeros:
            rows = rows + z[self.at["offset"]]
        rows = rows + self.one(z, "zero") + self.one(z, "drift") * share
        depth = found.depth + self.one(z, "depth_zero") + self.one(z, "depth_drift") * (2 * share[:, 0] - 1)
        return np.column_stack([rows, depth])

    def laid(self, z: Floats, found: Predicted) -> Laid:
        """The fitted stroke over the measured one."""
        s, fitted = self.stroke, self.predicted(z, found)
        return Laid(s.place_mm, s.press, s.rows_kPa, fitted[:, :-1], s.displacement_mm, fitted[:, -1])

    def seen(self, z: Floats, change: Floats) -> Floats:
        """What a change of computed images and depth, (n, rows + 1), does to the weighted residuals."""
        rows = self._lagged(z) @ (np.exp(self.one(z, "ln_E")) / FAT_KPA * change[:, :-1])
        return np.column_stack([rows * self._gain(z), change[:, -1]]) * self._weight

    def by_row(self, data: Floats) -> Floats:
        """Weighted residuals (n, rows + 1) of rows and displacement."""
        return data

    def _pressure(self, z: Floats, found: Predicted) -> Floats:
        return self._scale(z) * found.images

    def _scale(self, z: Floats) -> float:
        return float(np.exp(self.one(z, "ln_E"))) / FAT_KPA

    def _lagged(self, z: Floats) -> Floats:
        creep = 2 * self.one(z, "creep")
        return (1 - creep) * np.eye(len(self._lag)) + creep * self._lag

    def misfit(self, z: Floats, found: Predicted) -> Misfit:
        """Of a guess and its computed frames."""
        felt = np.column_stack([self.stroke.rows_kPa, self.stroke.displacement_mm])
        prior = (z - self.mean) / self.sd
        wander = z[self.at["force"]][self.stroke.press :] - self.one(z, "ln_F")
        return Misfit(
            (self.predicted(z, found) - felt) * self._weight,
            np.concatenate([prior, wander / self.force_sd, [self._padding(z)]]),
        )

    def _padding(self, z: Floats) -> float:
        """How far the padding's give is from what its owner says, in fat of 10 kPa, weighed."""
        names = [unknown.name for unknown in self.of.unknowns]
        if PADDING not in names:
            return 0.0
        told = np.log(self.stroke.face.yields_mm_per_kPa / FAT_KPA) + self.one(z, "ln_E")
        return float((z[names.index(PADDING)] - told) / _PADDING_SD)

    def jacobian(self, z: Floats, found: Predicted, slopes: Slopes) -> tuple[Floats, Floats]:
        """Of the misfit's data (n (rows + 1), size) and prior (size + frames of the stroke + 1, size)."""
        images, depth = slopes.images, slopes.depth
        n, p, at, rows = len(depth), self.stroke.press, self.at, self.stroke.rows_kPa.shape[1]
        E, share, frame = np.exp(self.one(z, "ln_E")) / FAT_KPA, self.stroke.share, np.arange(n)
        P, D = np.zeros((n, rows, self.size)), np.zeros((n, self.size))
        P[:, :, at["tissue"]], D[:, at["tissue"]] = E * images[:, :, :-2], depth[:, :-2]
        P[:, :, at["ln_E"]] = E * found.images[:, :, None]
        by_place, of_depth = E * images[:, :, -2], depth[:, -2]
        longer = 1 + self.one(z, "scale")
        P[:, :, at["start"]], D[:, at["start"]] = -by_place[:, :, None], -of_depth[:, None]
        stretch = -(self.places(z) + self.one(z, "start")) / longer
        P[:, :, at["scale"]] = (by_place * stretch[:, None])[:, :, None]
        D[:, at["scale"]] = (of_depth * stretch)[:, None]
        if not self.stroke.alone:
            own = at["place"].start + np.maximum(frame - p, 0)  # the press stands where the stroke begins
            P[frame, :, own], D[frame, own] = -by_place / longer, -of_depth / longer
        force = at["force"].start + frame
        P[frame, :, force], D[frame, force] = E * images[:, :, -1], depth[:, -1]
        operator, gain = self._lagged(z), self._gain(z)
        P = (operator @ P.reshape(n, -1)).reshape(P.shape) * gain[:, None]
        pressure = self._pressure(z, found)
        P[:, :, at["creep"]] = (2 * (self._lag @ pressure - pressure) * gain)[:, :, None]
        row = np.arange(rows)
        if len(self._gain_of):
            P[:, row, at["gain"].start + self._gain_of] = operator @ pressure
        if self.own_zeros:
            P[:, row, at["offset"].start + row] = 1.0
        P[:, :, at["zero"]], P[:, :, at["drift"]] = 1.0, share[:, None, None]
        D[:, at["depth_zero"]], D[:, at["depth_drift"]] = 1.0, (2 * share - 1)[:, None]
        data = np.concatenate([P, D[:, None]], 1) * self._weight[:, :, None]
        wander = np.zeros((n - p, self.size))
        wander[np.arange(n - p), at["force"].start + np.arange(p, n)] = 1 / self.force_sd
        wander[:, at["ln_F"]] = -1 / self.force_sd
        padding = np.zeros((1, self.size))
        if PADDING in (names := [unknown.name for unknown in self.of.unknowns]):
            padding[0, names.index(PADDING)], padding[0, at["ln_E"]] = 1 / _PADDING_SD, -1 / _PADDING_SD
        return data.reshape(-1, self.size), np.vstack([np.diag(1 / self.sd), wander, padding])

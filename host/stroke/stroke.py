"""One stroke, from its first frame to its estimate. Units: mm, kPa, N/m, s."""

from __future__ import annotations

import base64
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.answer.card import card, verdict
from palpate.stroke.area import Strip, base, strip
from palpate.stroke.found_lump import FoundLump, found_lump
from palpate.stroke.tactile_map import columns_over_lump, fit_growing_map, force_N_per_m, method_2, peak_kPa
from palpate.wire.cells import SHAPE
from palpate.wire.events import Estimate, Frame, MapFit, TactileMap

if TYPE_CHECKING:
    from palpate.answer.told import Told

MAX_IMAGES = 96
MAX_FRAMES = 4096
MAX_TRACE_POINTS = 400
_IMAGE_STEP_KPA = 1e-3
_NEAR_MM = 1.5
"""Images taken so near the lump's middle are averaged into the one over it."""


def _rounded(values: Any, digits: int) -> list[float]:
    return [float(v) for v in np.round(np.asarray(values, dtype=np.float64), digits)]


@dataclass
class FollowedStroke:
    """What is kept of one stroke: at most `MAX_IMAGES` images and `MAX_FRAMES` points of the traces (a
    probe left in contact for hours must not fill the memory); beyond that, every second one is dropped.

    `told` is what the host adds to the estimate, `map` the probe's own; `refined` is the card of its fit by
    the forward model, None where nobody fits it. `lane_mm` is how far across its middle line lies, None where
    the operator has not said."""

    number: int
    visit: int
    started_s: float
    wall_time: float = field(default_factory=time.time)
    ended_s: float = 0.0
    frames: int = 0
    force_low: bool = False
    force_high: bool = False
    too_fast: bool = False
    gaps: int = 0
    peak_kPa: float = 0.0
    fat_kPa: float | None = None
    lane_mm: float | None = None
    estimate: Estimate | None = None
    told: Told | None = None
    refined: dict[str, Any] | None = None
    map: TactileMap | None = None
    position_mm: list[float] = field(default_factory=list)
    displacement_mm: list[float] = field(default_factory=list)
    force_N_per_m: list[float] = field(default_factory=list)
    image_position_mm: list[float] = field(default_factory=list)
    images: list[NDArray[np.uint16]] = field(default_factory=list)
    _image_every: int = 1
    _trace_every: int = 1
    _last_seq: int | None = None
    _strip: Strip | None = None
    _base: list[float] | None = None

    def add(self, frame: Frame) -> None:
        """Take one more frame."""
        if self._last_seq is not None and frame.seq > self._last_seq + 1:
            self.gaps += frame.seq - self._last_seq - 1
        self._last_seq = frame.seq
        self.ended_s = frame.time_us * 1e-6
        pressure_kPa = frame.pressure_kPa
        self.peak_kPa = max(self.peak_kPa, peak_kPa(pressure_kPa))
        if self.frames % self._trace_every == 0:
            self.position_mm.append(frame.position_mm)
            self.displacement_mm.append(frame.displacement_mm)
            self.force_N_per_m.append(force_N_per_m(pressure_kPa))
            if len(self.position_mm) > MAX_FRAMES:
                for trace in (self.position_mm, self.displacement_mm, self.force_N_per_m):
                    del trace[1::2]
                self._trace_every *= 2
        if self.frames % self._image_every == 0:
            steps = np.clip(np.round(pressure_kPa / _IMAGE_STEP_KPA), 0, 65535)
            self.images.append(steps.astype(np.uint16))
            self.image_position_mm.append(frame.position_mm)
            if len(self.images) > MAX_IMAGES:
                self.images, self.image_position_mm = self.images[::2], self.image_position_mm[::2]
                self._image_every *= 2
        self.frames += 1

    def images_kPa(self) -> NDArray[np.float64]:
        """The images kept (n, rows, columns), kPa; there must be one."""
        return np.stack(self.images).astype(np.float64) * _IMAGE_STEP_KPA

    def tactile_map(self) -> tuple[list[float], list[float], MapFit | None]:
        """The map as far as it goes, computed here from the frames."""
        if len(self.images) < 2:
            return [], [], None
        images = self.images_kPa()
        seen = images[:, :, columns_over_lump(images)].mean(axis=2)
        x, p, rows = method_2(np.asarray(self.image_position_mm), seen)
        whole = rows >= (rows.max() if rows.size else 0)
        return _rounded(x, 2), _rounded(p, 4), fit_growing_map(x[whole], p[whole])

    def progress(self) -> dict[str, Any]:
        """The running stroke for the page."""
        x, p, fit = self.tactile_map()
        return {
            "type": "progress",
            "number": self.number,
            "visit": self.visit,
            "lane_mm": self.lane_mm,
            "map": {"x_mm": x, "pressure_kPa": p, "by": "viewer"},
            "fit": _fit_json(fit),
            "traces": self._traces(),
            "base": self.base(),
        }

    def summary(self) -> dict[str, Any]:
        """One line of the history."""
        return {
            "number": self.number,
            "visit": self.visit,
            "started_s": round(self.started_s, 3),
            "duration_s": round(self.ended_s - self.started_s, 3),
            "wall_time": self.wall_time,
            "frames": self.frames,
            "gaps": self.gaps,
            "too_fast": self.too_fast,
            "peak_kPa": round(self.peak_kPa, 3),
            "lane_mm": self.lane_mm,
            "refined": self.refined,
            "lump": None if (lump := self.lump()) is None else lump.as_dict(),
            "card": card(
                self.estimate,
                self.told,
                force_low=self.force_low,
                force_high=self.force_high,
                fat_kPa=self.fat_kPa,
            ),
        }

    def detail(self, *, images: bool = True) -> dict[str, Any]:
        """The whole stroke, to show it again: the probe's own map and fit where it sent them."""
        x, p, fit = self.tactile_map()
        by = "viewer"
        if self.map is not None:
            x, p = _rounded(self.map.x_mm, 3), _rounded(self.map.pressure_kPa, 5)
            fit, by = self.map.fit or fit, "probe"
        out = {
            "type": "stroke",
            **self.summary(),
            "map": {"x_mm": x, "pressure_kPa": p, "by": by},
            "fit": _fit_json(fit),
            "traces": self._traces(),
            "over_lump": self._over_lump(),
            "base": self.base(),
        }
        if images:
            stack = np.stack(self.images) if self.images else np.empty((0, *SHAPE), np.uint16)
            out["images"] = {
                "position_mm": _rounded(self.image_position_mm, 3),
                "step_kPa": _IMAGE_STEP_KPA,
                "peak_kPa": _rounded([peak_kPa(image * _IMAGE_STEP_KPA) for image in self.images], 3),
                "uint16": base64.b64encode(stack.astype("<u2").tobytes()).decode("ascii"),
            }
        return out

    def lump(self) -> FoundLump | None:
        """Where its lump lies and how large it is; None where the card tells of none, or its map was lost."""
        kind = verdict(self.estimate, force_low=self.force_low, force_high=self.force_high)
        across = None if self.told is None else self.told.across
        return found_lump(kind, self.estimate, across, self.map)

    def base(self) -> list[float] | None:
        """Of each cell the base that its rise is told over, as a share of the image's mean; None before there
        is one."""
        if self.images:
            shares = base(self.images_kPa())
            self._base = None if shares is None else _rounded(shares.ravel(), 3)
        return self._base

    def strip(self) -> Strip:
        """Its strip of the visit's map; ask only once it is over."""
        if self._strip is None:
            images = self.images_kPa() if self.images else np.empty((0, *SHAPE))
            self._strip = strip(np.asarray(self.image_position_mm), images)
        return self._strip

    def _over_lump(self) -> dict[str, Any] | None:
        """The mean image with the probe over the lump."""
        if (lump := self.lump()) is None or not self.images:
            return None
        away = np.abs(np.asarray(self.image_position_mm) - lump.along_mm)
        near = np.flatnonzero(away <= max(_NEAR_MM, float(away.min())))
        mean = np.mean([self.images[n] for n in near], axis=0) * _IMAGE_STEP_KPA
        position_mm = np.mean([self.image_position_mm[n] for n in near])
        return {"position_mm": round(float(position_mm), 3), "pressure_kPa": _rounded(mean.ravel(), 3)}

    def drop_images(self) -> None:
        """Keep numbers, traces and the strip of the map only: an old stroke of a long session."""
        self.strip()
        self.base()
        self.images, self.image_position_mm = [], []

    def value(self, key: str) -> float | None:
        """A number of the card (`d_mm`, `depth_mm`, `t_mm`, `F_N_per_m`) if the card vouches for it, else
        None."""
        found = self.summary()["card"]
        if found["kind"] != "lump":
            return None
        return next((float(row["value"]) for row in found["rows"] if row["key"] == key), None)

    def _traces(self) -> dict[str, list[float]]:
        step = -(-len(self.position_mm) // MAX_TRACE_POINTS) or 1
        return {
            "position_mm": _rounded(self.position_mm[::step], 3),
            "displacement_mm": _rounded(self.displacement_mm[::step], 4),
            "force_N_per_m": _rounded(self.force_N_per_m[::step], 3),
        }


def _fit_json(fit: MapFit | None) -> dict[str, float] | None:
    if fit is None:
        return None
    return {
        "base_kPa": round(fit.base_kPa, 5),
        "amp_kPa": round(fit.amp_kPa, 5),
        "centre_mm": round(fit.centre_mm, 3),
        "stdev_mm": round(fit.stdev_mm, 3),
    }

"""The firmware's integer pipeline on the host, at the host's speed and to the last bit the same.

The very source that the probe runs is compiled by numba; tests/firmware_py holds it equal to plain CPython.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import time
import types
from collections.abc import Iterable, Sequence
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from firmware_py import (
    calib,
    feature_chain,
    feature_names,
    forcemap,
    gauss,
    settings,
    stroke_state,
)
from palpate.errors import UsageError
from palpate.firmware_twin import twin

_HALF_MM = feature_chain.HALF_UM / 1000


def cache_folder() -> Path:
    """Where the machine code of this firmware is kept: named by the hash of all sources, since numba itself
    does not notice that a function called from another file has changed."""
    digest = hashlib.sha256(version("numba").encode())
    for name in ("sensor_array", "geometry", *twin.STAGES):
        digest.update(twin.source_of(name).read_bytes())
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "palpate" / f"compiled-{digest.hexdigest()[:16]}"


@lru_cache(maxsize=1)
def compiled() -> types.SimpleNamespace:
    """The firmware's modules with every function compiled; machine code is cached between runs."""
    import numba
    from numba.core import config as numba_config

    config: Any = numba_config
    before = config.CACHE_DIR
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        cache = os.access(folder, os.W_OK)
        _forget_old(folder)
    except OSError:
        cache = False
    config.CACHE_DIR = str(folder) if cache else before
    try:
        return twin.load(label="compiled", wrap=lambda f: numba.njit(f, cache=cache, nogil=True))
    finally:
        config.CACHE_DIR = before


def _forget_old(folder: Path) -> None:
    """Remove the machine code of firmware that nobody has run for a fortnight; mark this one as run."""
    os.utime(folder)
    for other in folder.parent.glob("compiled-*"):
        if other != folder and time.time() - other.stat().st_mtime > 14 * 86400:
            shutil.rmtree(other, ignore_errors=True)


class TwinFrames(Protocol):
    """A stroke as a simulated probe sends it; `press` counts the first frames, before it moves."""

    @property
    def packed(self) -> list[bytes]: ...

    @property
    def positions_um(self) -> NDArray[np.int64]: ...

    @property
    def displacements_um(self) -> NDArray[np.int64]: ...

    @property
    def press(self) -> int: ...


class Replay:
    """A pipeline to push strokes through, one after the other.

    Parameters
    ----------
    force_map : bytes, optional
        The blob that the model carries (palpate.model_export.integers.force_map.blob).
    plain : bool
        Run the firmware under plain CPython instead (a hundred times slower), to compare.
    n_bins, width_um : int, optional
        As for firmware_py.pipeline.Pipeline.
    """

    def __init__(
        self,
        force_map: bytes | None = None,
        *,
        plain: bool = False,
        **bins: int,
    ) -> None:
        modules: Any = twin.plain() if plain else compiled()
        self.force_map = None
        if force_map is not None:
            self.force_map = forcemap.load(force_map)
            if self.force_map is None:
                raise UsageError("the model's force map is of a kind that this firmware does not know")
        self.pipeline = modules.pipeline.Pipeline(calib.Calibration(), **bins)

    def stroke(
        self,
        packed: Iterable[bytes],
        positions_um: Sequence[int] | NDArray[np.int64],
        displacements_um: Sequence[int] | NDArray[np.int64],
        calibration: calib.Calibration | None = None,
        press: tuple[Iterable[bytes], Iterable[int]] = ((), ()),
    ) -> int:
        """Push one stroke through; returns the pipeline's status. Results are in `pipeline`.

        press : packed frames and displacements_um between contact and the stroke's first frame.
        """
        p = self.pipeline
        if calibration is not None:
            p.calibration = calibration
        p.begin_press()
        for frame, d in zip(*press, strict=True):
            p.add_press(frame, int(d))
        p.reset()
        for frame, x, d in zip(packed, positions_um, displacements_um, strict=True):
            p.add_frame(frame, int(x), int(d))
        return int(p.finish(self.force_map))

    def stream(self, frames: TwinFrames, calibration: calib.Calibration | None = None) -> int:
        """The same for a stroke of palpate.sim.probe.sensors, with the press before it if it has one.

        Of the press the probe sees what comes after it has noticed the contact.
        """
        if calibration is not None:
            self.pipeline.calibration = calibration
        n = frames.press
        touched = self._contact(frames.packed[:n])
        press = (frames.packed[touched:n], frames.displacements_um[touched:n].tolist())
        return self.stroke(
            frames.packed[n:], frames.positions_um[n:], frames.displacements_um[n:], calibration, press
        )

    def _contact(self, packed: Sequence[bytes]) -> int:
        """Which of these frames is the first that the probe takes for contact."""
        if not packed:
            return 0
        zero = sum(self.pipeline.calibration.offset) >> 3
        state = stroke_state.StrokeState(settings.Settings().values, zero)
        return next((k for k, frame in enumerate(packed) if state.in_contact(frame)), len(packed))

    def features(self) -> NDArray[np.float64]:
        """The last stroke's features in their own units, in the order of feature_names.NAMES."""
        return np.array(self.pipeline.features, float) / 2**24

    def results(self) -> dict[str, Any]:
        """The last stroke in physical units: map, fit, place, columns, features by name."""
        p = self.pipeline
        unit_kPa = p.calibration.count_mpa / 2**11 / 1e6
        fit = np.array(p.fit, float)
        place_mm = p.place_um / 1e3
        return {
            "map": {
                "x_mm": np.arange(feature_chain.POINTS) - _HALF_MM + place_mm,
                "pressure_kPa": np.array(p.map) * unit_kPa,
            },
            "base_kPa": fit[gauss.BASE] * unit_kPa,
            "amp_kPa": fit[gauss.AMP] * unit_kPa,
            "centre_mm": fit[gauss.CENTRE] / 2**16 - _HALF_MM + place_mm,
            "stdev_mm": fit[gauss.STDEV] / 2**16,
            "columns": (p.span[0], p.span[1]),
            "features": dict(zip(feature_names.NAMES, self.features().tolist(), strict=True)),
        }

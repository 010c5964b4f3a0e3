"""A probe's stream in rerun: its image, map, motion and estimates, with a layout that shows them.

Entities: face (tensor, kPa), motion/position, motion/displacement, motion/force (scalars: mm, mm, N), map
(bars, kPa over mm), estimate and log (text). Timelines: probe (its own clock) and host (Unix time).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.errors import MissingExtra, PalpateError, UsageError
from palpate.wire.cells import FULL_SCALE_KPA, PITCH_MM
from palpate.wire.events import Estimate, Event, Frame, Log, TactileMap

if TYPE_CHECKING:
    from palpate.answer.told import Told

SPAWN = "spawn"
Words = Callable[[Estimate, "Told | None"], list[str]]


class RerunLog:
    """Takes a stream's events; use as a context manager.

    Parameters
    ----------
    where : str
        FILE.rrd, or "spawn" for the viewer.
    overwrite : bool
        Replace a file that is there.
    words : callable
        An estimate in lines of text.

    Raises
    ------
    MissingExtra
        rerun-sdk is not installed.
    UsageError, PalpateError
        Another file name, or one that is taken; on entering: it cannot be written, the viewer does not start.
    """

    def __init__(self, where: str, overwrite: bool, words: Words) -> None:
        try:
            import rerun
        except ImportError as error:
            raise MissingExtra("rerun-sdk", "rerun", "writing for rerun") from error
        self._rr: Any = rerun
        self._words = words
        self._stream = rerun.RecordingStream("palpate")
        path = Path(where)
        if where != SPAWN:
            if path.suffix != ".rrd":
                raise UsageError(f"--rerun takes FILE.rrd or {SPAWN}, not {where!r}")
            if path.exists() and not overwrite:
                raise PalpateError(f"{path} exists already; choose another name or give --overwrite")
        self._where = where

    def __enter__(self) -> RerunLog:
        path = Path(self._where)
        try:
            if self._where == SPAWN:
                self._stream.spawn(default_blueprint=layout())
            else:
                path.parent.mkdir(parents=True, exist_ok=True)
                self._stream.save(path, default_blueprint=layout())
        except (RuntimeError, OSError) as error:
            raise PalpateError(f"rerun cannot begin with {path}: {' '.join(str(error).split())}") from error
        for name in ("position, mm", "displacement, mm", "force, N"):
            self._stream.log(f"motion/{name.split(',')[0]}", self._rr.SeriesLines(names=name), static=True)
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.flush()
        self._stream.disconnect()

    def push(self, event: Event, told: Told | None = None) -> None:
        """Log one event; those of other kinds are left out. `told`: what the host adds to an estimate."""
        rr, log = self._rr, self._stream.log
        time_us = getattr(event, "time_us", None)
        if time_us is not None:
            self._stream.set_time("probe", duration=time_us * 1e-6)
        self._stream.set_time("host", timestamp=event.host_ns * 1e-9)
        if isinstance(event, Frame):
            kPa = event.pressure_kPa
            log("face", rr.Tensor(kPa, dim_names=("along", "across"), value_range=(0.0, FULL_SCALE_KPA)))
            log("motion/position", rr.Scalars(event.position_mm))
            log("motion/displacement", rr.Scalars(event.displacement_mm))
            log("motion/force", rr.Scalars(float(kPa.sum(dtype=float)) * PITCH_MM**2 / 1000))
        elif isinstance(event, TactileMap) and event.usable:
            log("map", rr.BarChart(event.pressure_kPa, abscissa=event.x_mm))
        elif isinstance(event, Estimate):
            log("estimate", rr.TextDocument("\n".join(self._words(event, told))))
        elif isinstance(event, Log):
            log("log", rr.TextLog(event.text, level=("INFO", "WARN", "ERROR")[min(event.level, 2)]))


def layout() -> Any:
    """The image and the map on the left, motion, estimate and log on the right."""
    import rerun.blueprint as rrb

    colours = rrb.TensorScalarMapping(colormap="viridis")
    face = rrb.TensorView(origin="face", name="pressure, kPa", scalar_mapping=colours)
    left = rrb.Vertical(face, rrb.BarChartView(origin="map", name="tactile map, kPa over mm"))
    right = rrb.Vertical(
        rrb.TimeSeriesView(origin="motion", name="displacement, position, force"),
        rrb.TextDocumentView(origin="estimate", name="estimate"),
        rrb.TextLogView(origin="log", name="log"),
    )
    return rrb.Blueprint(rrb.Horizontal(left, right), collapse_panels=True)

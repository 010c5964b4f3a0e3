"""A source that makes up strokes, for tests of the viewer that need no probe: bumps whose answer is known."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from palpate.across.layers import LumpLayer
from palpate.sim.probe.cells import COLUMN_MM, ROW_MM
from palpate.view.events import (
    Device,
    Estimate,
    Event,
    Frame,
    Health,
    Interval,
    LinkChanged,
    LinkState,
    MapFit,
    Playback,
    ProbeMap,
    StrokeState,
)
from palpate.view.source import Emit

DEVICE = Device("Made-up probe", serial="TEST-1", firmware="0", runtime="python", model_id="0011223344556677")
GONE = "The probe is gone. Plug it in again; this page goes on by itself."
ACROSS_MM = COLUMN_MM


@dataclass(frozen=True)
class Bump:
    """What the made-up stroke goes over, and what the probe says of it."""

    d_mm: float = 10.0
    h: float = 0.8
    base_kPa: float = 4.5
    amp_kPa: float = 3.2
    stdev_mm: float = 4.6
    kind: str = "lump"
    hardness: str = "hard"
    E_inv23: float = 0.21
    E_fat_kPa: float | None = None
    across_mm: float = 3.0
    columns: tuple[int, int] = (11, 19)
    layer: LumpLayer | None = None
    width_mm: float | None = None
    place_mm: float | None = None
    outside: tuple[str, ...] = ()


IN_GLAND = LumpLayer(
    level=0.9,
    place="in the gland",
    odds={"in the fat": 0.0, "at the border": 0.1, "in the gland": 0.9},
    in_fat=(-0.4, -0.9, 0.1),
    depth_mm=(15.0, 12.0, 19.0),
    sizes=((3.1, 13.4), (None, 10.1)),
    within=0.07,
    worth_saying=True,
)


def _around(value: float, share: float) -> Interval:
    return Interval(value, value * (1 - share), value * (1 + share))


def estimate(bump: Bump, time_s: float) -> Estimate:
    """The answer that belongs to a bump."""
    return Estimate(
        time_s,
        F_N_per_m=_around(100.0, 0.03),
        t_mm=_around(bump.d_mm * (bump.h + 0.5), 0.04),
        d_mm=_around(bump.d_mm, 0.07),
        h=_around(bump.h, 0.09),
        E_inv23=Interval(bump.E_inv23, bump.E_inv23 - 0.12, bump.E_inv23 + 0.12),
        further={} if bump.E_fat_kPa is None else {"E_fat_kPa": _around(bump.E_fat_kPa, 0.06)},
        lump=bump.kind in ("lump", "outside"),
        layer=bump.layer,
        width_mm=None if bump.width_mm is None else _around(bump.width_mm, 0.3),
        place_mm=None if bump.place_mm is None else _around(bump.place_mm, 0.2),
        outside=bump.outside,
        hardness=bump.hardness,
        in_domain=bump.kind == "lump",
        force_out=bump.kind == "force",
        invalid=bump.kind == "unread",
        level=0.9,
        model_id="0011223344556677",
    )


def image(bump: Bump, position_mm: float, rng: np.random.Generator) -> np.ndarray:
    """The tactile image with the lump `position_mm` behind the middle of the face."""
    along = position_mm + ROW_MM[:, None]
    across = ACROSS_MM[None, :]
    amp = 0.0 if bump.kind == "none" else bump.amp_kPa
    hill = amp * np.exp(-0.5 * (along / bump.stdev_mm) ** 2 - 0.5 * ((across - bump.across_mm) / 5.0) ** 2)
    face = 1.0 - 0.25 * (ROW_MM[:, None] / 12.0) ** 2 - 0.1 * (across / 20.0) ** 2
    noise = rng.normal(0.0, 0.05, (ROW_MM.size, COLUMN_MM.size))
    return np.maximum(bump.base_kPa * face + hill + noise, 0.0).astype(np.float32)


def stroke(bump: Bump, start_s: float, seq: int, rate: float, seconds: float, seed: int) -> Iterator[Event]:
    """The events of one stroke, times included, from -28 to 28 mm."""
    rng = np.random.default_rng(seed)
    low = bump.kind == "force"
    n = int(rate * seconds)
    yield StrokeState(start_s, contact=True, force_low=low)
    for i in range(n):
        x = -28.0 + 56.0 * i / (n - 1)
        t = start_s + i / rate
        near = bump.kind != "none" and abs(x) < 6.0
        if i == 0 or near != (abs(x - 56.0 / (n - 1)) < 6.0):
            yield StrokeState(t, contact=True, stroke=True, lump=near, force_low=low)
        depth = 2.56 - (0.0 if bump.kind == "none" else 0.5) * np.exp(-0.5 * (x / 9.0) ** 2)
        yield Frame(seq + i, t, time.time(), x, float(depth + rng.normal(0, 0.008)), image(bump, x, rng))
    end = start_s + n / rate
    yield StrokeState(end, contact=True)
    x = np.arange(-28.0, 29.0)
    fit = None if bump.kind == "none" else MapFit(bump.base_kPa * 0.9, bump.amp_kPa * 0.6, 0.0, bump.stdev_mm)
    p = (
        np.full(x.size, bump.base_kPa * 0.9)
        if fit is None
        else fit.base_kPa + fit.amp_kPa * np.exp(-0.5 * (x / fit.stdev_mm) ** 2)
    )
    yield ProbeMap(tuple(x), tuple(p), fit, bump.columns)
    yield estimate(bump, end)


class SyntheticSource:
    """Strokes one after the other, paced, at `rate` frames/s; stops and goes on when a test says so.

    Attributes
    ----------
    plugged : threading.Event
        Cleared, the probe is gone; set, it is back.
    limit : int or None
        So many strokes, then the probe lies still.
    halt_mm : float or None
        Where every stroke stands still, at ten frames a second, until this is set anew.
    lifts : bool
        Whether each stroke ends with the probe in the air.
    gone : str
        What is said while it is gone.
    told : list of str
        What the page asked for, in order.
    """

    def __init__(
        self,
        bumps: list[Bump],
        *,
        rate: float = 100.0,
        seconds: float = 2.0,
        rest: float = 0.3,
        limit: int | None = None,
    ) -> None:
        self.name = "Made-up probe"
        self.bumps = bumps
        self.rate = rate
        self.seconds = seconds
        self.rest = rest
        self.limit = limit
        self.halt_mm: float | None = None
        self.lifts = False
        self.gone = GONE
        self.plugged = threading.Event()
        self.plugged.set()
        self.recording = False
        self.recorded: list[Path] = []
        self.marks: list[str] = []
        self.told: list[str] = []
        self.seq = 0

    def start_recording(self, path: Path) -> None:
        path.write_bytes(b"")
        self.recording = True
        self.recorded.append(path)
        self.told.append("start")

    def stop_recording(self) -> None:
        self.recording = False
        self.told.append("stop")

    def mark(self, text: str) -> None:
        self.told.append(f"mark {text}")
        self.marks.append(text)

    def run(self, emit: Emit, stop: threading.Event) -> None:
        emit(LinkChanged(LinkState.CONNECTED, "Connected.", DEVICE))
        number = 0
        while not stop.is_set():
            if not self.plugged.is_set():
                emit(LinkChanged(LinkState.GONE, self.gone))
                while not (self.plugged.wait(0.05) or stop.is_set()):
                    pass
                emit(LinkChanged(LinkState.CONNECTED, "Connected.", DEVICE))
            elif self.limit is not None and number >= self.limit:
                stop.wait(0.01)
            elif self._stroke(number, emit, stop):
                number += 1
                stop.wait(self.rest)

    def _stroke(self, number: int, emit: Emit, stop: threading.Event) -> bool:
        """One stroke in its own time; False if it was cut off."""
        begin = time.monotonic()
        stood_s = 0.0
        bump = self.bumps[number % len(self.bumps)]
        for event in stroke(bump, begin, self.seq, self.rate, self.seconds, number):
            if isinstance(event, Frame):
                while self.halt_mm is not None and event.position_mm >= self.halt_mm:
                    if stop.is_set() or not self.plugged.is_set():
                        return False
                    self._frame(event, stood_s, emit)
                    stood_s += 0.1
                    time.sleep(0.1)
                wait = event.time_s + stood_s - time.monotonic()
                if wait > 0:
                    time.sleep(wait)
                self._frame(event, stood_s, emit)
            elif isinstance(event, ProbeMap):
                emit(event)
            else:
                emit(replace(event, time_s=event.time_s + stood_s))
            if stop.is_set() or not self.plugged.is_set():
                return False
        if self.lifts:
            emit(StrokeState(time.monotonic()))
        return True

    def _frame(self, frame: Frame, later_s: float, emit: Emit) -> None:
        emit(replace(frame, seq=self.seq, time_s=frame.time_s + later_s, host_time_s=time.time()))
        self.seq += 1
        if self.seq % int(self.rate / 2) == 0:
            emit(Health(self.rate, self.seq, 0, 0, 0, 0, 0, 3.2))


class SyntheticReplay:
    """A recording of a minute without strokes. It takes commands as a real one does, and says where it is
    when a test tells it to, early or late."""

    def __init__(self) -> None:
        self.name = "made-up.mcap"
        self.now = Playback(0.0, 60.0, playing=False, speed=1.0)
        self.emit: Emit = lambda event: None

    def play(self) -> int:
        return self._apply(playing=True)

    def pause(self) -> int:
        return self._apply(playing=False)

    def seek(self, position_s: float) -> int:
        return self._apply(position_s=position_s)

    def set_speed(self, speed: float) -> int:
        return self._apply(speed=speed)

    def _apply(self, **changed: float) -> int:
        self.now = replace(self.now, commands_applied=self.now.commands_applied + 1, **changed)
        return self.now.commands_applied

    def run(self, emit: Emit, stop: threading.Event) -> None:
        self.emit = emit
        emit(LinkChanged(LinkState.CONNECTED, "", DEVICE))
        emit(self.now)
        stop.wait()

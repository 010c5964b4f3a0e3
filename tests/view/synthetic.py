"""A source that makes up strokes, for tests of the viewer that need no probe: bumps whose answer is known."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from host.view.events import (
    COLUMNS,
    ROW_MM,
    Device,
    Estimate,
    Event,
    Frame,
    Health,
    Interval,
    LinkChanged,
    LinkState,
    MapFit,
    ProbeMap,
    StrokeState,
)
from host.view.source import Emit

DEVICE = Device("Made-up probe", serial="TEST-1", firmware="0", runtime="python", model_id="0011223344556677")
ACROSS_MM = (np.arange(COLUMNS) - (COLUMNS - 1) / 2) * 1.5


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
        lump=bump.kind in ("lump", "outside"),
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
    hill = amp * np.exp(-0.5 * (along / bump.stdev_mm) ** 2 - 0.5 * ((across - 3.0) / 5.0) ** 2)
    face = 1.0 - 0.25 * (ROW_MM[:, None] / 12.0) ** 2 - 0.1 * (across / 20.0) ** 2
    noise = rng.normal(0.0, 0.05, (ROW_MM.size, COLUMNS))
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
    yield ProbeMap(tuple(x), tuple(p), fit)
    yield estimate(bump, end)


class SyntheticSource:
    """Strokes one after the other, paced, at `rate` frames/s; `unplug` and `replug` at will."""

    def __init__(
        self, bumps: list[Bump], *, rate: float = 100.0, seconds: float = 2.0, rest: float = 0.3
    ) -> None:
        self.name = "Made-up probe"
        self.bumps = bumps
        self.rate = rate
        self.seconds = seconds
        self.rest = rest
        self.plugged = threading.Event()
        self.plugged.set()
        self.recorded: list[Path] = []
        self.marks: list[str] = []
        self.told: list[str] = []
        """What the page asked for, in order."""

    def start_recording(self, path: Path) -> None:
        path.write_bytes(b"")
        self.recorded.append(path)
        self.told.append("start")

    def stop_recording(self) -> None:
        self.told.append("stop")

    def mark(self, text: str) -> None:
        self.told.append(f"mark {text}")
        self.marks.append(text)

    def run(self, emit: Emit, stop: threading.Event) -> None:
        emit(LinkChanged(LinkState.CONNECTED, "Connected.", DEVICE))
        begin, seq, at = time.monotonic(), 0, 0.0
        number = 0
        while not stop.is_set():
            bump = self.bumps[number % len(self.bumps)]
            for event in stroke(bump, at, seq, self.rate, self.seconds, number):
                if stop.is_set():
                    return
                if not self.plugged.is_set():
                    emit(
                        LinkChanged(
                            LinkState.GONE,
                            "The probe is gone. Plug it in again; this page goes on by itself.",
                        )
                    )
                    while not self.plugged.wait(0.05):
                        if stop.is_set():
                            return
                    emit(LinkChanged(LinkState.CONNECTED, "Connected.", DEVICE))
                    begin = time.monotonic() - (event.time_s if not isinstance(event, ProbeMap) else at)
                    break
                if isinstance(event, Frame):
                    wait = begin + event.time_s - time.monotonic()
                    if wait > 0:
                        time.sleep(wait)
                    seq = event.seq + 1
                    if seq % int(self.rate / 2) == 0:
                        emit(Health(self.rate, seq, 0, 0, 0, 0, 0, 3.2))
                emit(event)
            number += 1
            at = time.monotonic() - begin + self.rest
            if stop.wait(self.rest):
                return

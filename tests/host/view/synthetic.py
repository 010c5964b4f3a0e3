"""A source that makes up strokes, for tests of the viewer that need no probe: bumps whose answer is known."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from firmware_py import geometry, outputs, status
from palpate.answer.layers import LumpLayer
from palpate.answer.told import AcrossStroke, Told
from palpate.stroke.answered import Answered
from palpate.view.notices import Health, LinkChanged, LinkState, OtherEnd, Playback
from palpate.view.source import Emit
from palpate.wire.cells import COLUMN_MM, FULL_SCALE_KPA, PEDESTAL_KPA, ROW_MM
from palpate.wire.events import OUTPUTS, Estimate, Event, Frame, StrokeState, TactileMap
from palpate.wire.packing import pack

DEVICE = OtherEnd(
    "Made-up probe", serial="TEST-1", firmware="0", runtime="python", model_id="0011223344556677"
)
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


def _around(value: float, share: float) -> tuple[float, float, float]:
    return value, value * (1 - share), value * (1 + share)


def us(time_s: float) -> int:
    """A probe's time."""
    return round(time_s * 1e6)


def state(time_s: float, change: str) -> StrokeState:
    """A change that the probe tells."""
    return StrokeState(time.time_ns(), 0, 1, 1, change, us(time_s), 0, 0)


def frame(
    seq: int, time_s: float, position_mm: float, displacement_mm: float, image_kPa: np.ndarray
) -> Frame:
    """A frame of the nominal sensor."""
    counts = np.rint((image_kPa + PEDESTAL_KPA) / FULL_SCALE_KPA * geometry.FULL_COUNT)
    packed = pack(counts.clip(0, geometry.FULL_COUNT))
    place = us(position_mm) // 1000, us(displacement_mm) // 1000
    return Frame(time.time_ns(), seq, us(time_s), *place, packed)


def estimate(bump: Bump, time_s: float, code: int = status.OK) -> Answered:
    """The answer that belongs to a bump; with another status there are no numbers."""
    spans = {
        "F_N_per_m": _around(100.0, 0.03),
        "t_mm": _around(bump.d_mm * (bump.h + 0.5), 0.04),
        "d_mm": _around(bump.d_mm, 0.07),
        "h": _around(bump.h, 0.09),
        "E_inv23": (bump.E_inv23, bump.E_inv23 - 0.12, bump.E_inv23 + 0.12),
        "E_fat_kPa": None if bump.E_fat_kPa is None else _around(bump.E_fat_kPa, 0.06),
    }
    values = [round(outputs.SCALE * v) for name in OUTPUTS for v in spans[name] or ()]
    flags = {"hard": outputs.HARD, "soft": outputs.SOFT}.get(bump.hardness, 0)
    flags |= outputs.LUMP * (bump.kind in ("lump", "outside")) | outputs.IN_DOMAIN * (bump.kind == "lump")
    flags |= outputs.FORCE_OUT * (bump.kind == "force") | outputs.INVALID * (bump.kind == "unread")
    said = Estimate(
        host_ns=time.time_ns(),
        stream=1,
        stroke=1,
        status=code,
        flags=flags,
        damage=0,
        level_permille=900,
        distance_permille=0,
        model_id=bytes.fromhex("0011223344556677"),
        frames=0,
        first_seq=0,
        last_seq=0,
        overrun=0,
        time_us=us(time_s),
        values=tuple(values) if code == status.OK else (),
    )
    width, place = bump.width_mm, bump.place_mm
    across = AcrossStroke(
        0.9, None if width is None else _around(width, 0.3), None if place is None else _around(place, 0.2)
    )
    return Answered(said.host_ns, said, Told(across, bump.layer, bump.outside))


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
    yield state(start_s, "contact")
    if low:
        yield state(start_s, "force_low")
    for i in range(n):
        x = -28.0 + 56.0 * i / (n - 1)
        t = start_s + i / rate
        if i == 0:
            yield state(t, "started")
            if low:
                yield state(t, "force_low")
        if bump.kind != "none" and abs(x) < 6.0 <= abs(x - 56.0 / (n - 1)):
            yield state(t, "lump_passed")
        depth = 2.56 - (0.0 if bump.kind == "none" else 0.5) * np.exp(-0.5 * (x / 9.0) ** 2)
        yield frame(seq + i, t, x, float(depth + rng.normal(0, 0.008)), image(bump, x, rng))
    end = start_s + n / rate
    yield state(end, "ended")
    yield probe_map(bump)
    yield estimate(bump, end)


def probe_map(bump: Bump) -> TactileMap:
    """The map that the probe makes of a bump, from -28 to 28 mm."""
    count_mpa = 1_000_000  # so that a unit of its values is 2^-11 kPa
    flat = bump.kind == "none"
    x = np.arange(-28.0, 29.0)
    amp = 0.0 if flat else bump.amp_kPa * 0.6
    kPa = bump.base_kPa * 0.9 + amp * np.exp(-0.5 * (x / bump.stdev_mm) ** 2)
    fit = (bump.base_kPa * 0.9, amp)
    return TactileMap(
        host_ns=time.time_ns(),
        stream=1,
        stroke=1,
        status=status.NO_FIT if flat else status.OK,
        first_column=bump.columns[0],
        end_column=bump.columns[1],
        points=x.size,
        first_mm=-28,
        place_um=0,
        count_mpa=count_mpa,
        base_q11=round(fit[0] * 2**11),
        amplitude_q11=round(fit[1] * 2**11),
        centre_q16=28 << 16,
        stdev_q16=round(bump.stdev_mm * 2**16),
        values=tuple(np.rint(kPa * 2**11).astype(int).tolist()),
    )


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
                wait = event.time_us * 1e-6 + stood_s - time.monotonic()
                if wait > 0:
                    time.sleep(wait)
                self._frame(event, stood_s, emit)
            elif isinstance(event, StrokeState):
                emit(replace(event, time_us=event.time_us + us(stood_s)))
            elif isinstance(event, Answered):
                later = replace(event.estimate, time_us=event.estimate.time_us + us(stood_s))
                emit(replace(event, estimate=later))
            else:
                emit(event)
            if stop.is_set() or not self.plugged.is_set():
                return False
        if self.lifts:
            emit(state(time.monotonic(), "lifted"))
        return True

    def _frame(self, frame: Frame, later_s: float, emit: Emit) -> None:
        now_us = frame.time_us + us(later_s)
        emit(replace(frame, seq=self.seq, time_us=now_us, host_ns=time.time_ns()))
        self.seq += 1
        if self.seq % int(self.rate / 2) == 0:
            emit(Health(self.rate, latency_ms=3.2))


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

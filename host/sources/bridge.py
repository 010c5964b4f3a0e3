"""An array as a probe: the firmware runs here, in a thread, and its sensors are the images that come.

So a stream, a recording, the page and `palpate doctor` need to know nothing of other people's arrays.
"""

from __future__ import annotations

import hashlib
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from firmware_py import acquire, estimator, geometry, messages, probe, settings, status, store
from palpate.array import words_of
from palpate.errors import LinkError, LinkGone, PortError, UsageError
from palpate.sources.array_line import Image, OpenArray
from palpate.sources.encoder import GAP_US, PlaceSource
from palpate.sources.kept import Kept, drift, place
from palpate.sources.steady import SETTLED, Steady
from palpate.wire.packing import pack
from palpate.wire.scale import NOMINAL

FIRST_S = 3.0
"""So long an array may take to send its first image."""
AIR_FRAMES = 30
LOOK_S = 0.01
WATCH_S = 60.0
"""Drift is told after so long in the air."""
DRIFT_PA = 30.0
"""A minute; less is not worth telling."""
_MASK = (1 << 30) - 1
_NOBODY_READS = 1 << 22


class Reading:
    """Images of an open line in kPa: by its calibration where it has one, else by its full scale.

    Raises
    ------
    PortError
        No image comes; the sentence says why.
    UsageError
        Palpate works with another array in this process, or the calibration kept is another array's.
    """

    def __init__(self, line: OpenArray) -> None:
        self.line = line
        rows, columns, pitch_mm, self._full_kPa = line.source.shape_
        wanted = rows, columns, round(1000 * pitch_mm)
        if wanted != (geometry.ROWS, geometry.COLUMNS, geometry.PITCH_UM):
            words = words_of(*line.source.shape_)
            raise UsageError(
                f"this program works with {geometry.NAME.decode()}; set PALPATE_ARRAY={words} first"
            )
        self.kept = Kept.load(place(line.source.address), rows, columns)
        self.steady = Steady()
        line.drain()
        first = self.take(max(AIR_FRAMES, SETTLED + 1))
        if line.encoder is not None:
            line.encoder.look(time.monotonic_ns() / 1000, FIRST_S)
            line.encoder.check()
        self.air = np.array(self.kept.air).reshape(rows, columns) if self.kept.air else first.mean(axis=0)
        self.curves: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
        if self.kept.points:
            a, b = (each.reshape(rows, columns) for each in self.kept.curves)
            self.curves = np.nan_to_num(a), np.nan_to_num(b, nan=1.0)

    def next(self, timeout_s: float) -> list[tuple[Image, float, int]]:
        """Raw images that have come, with their times in us and how many seem lost before each."""
        images = self.line.read(timeout_s)
        stamps = self.steady.stamp(len(images), time.monotonic_ns() / 1000)
        return [(image, time_us, missed) for image, (time_us, missed) in zip(images, stamps)]

    def take(self, frames: int) -> NDArray[np.float64]:
        """So many raw images (frames, rows, columns)."""
        found: list[Image] = []
        deadline = time.monotonic() + FIRST_S
        while len(found) < frames:
            came = [image for image, *_ in self.next(0.1)]
            found += came
            if came:
                deadline = time.monotonic() + FIRST_S
            elif time.monotonic() > deadline:
                where = self.line.source.address.text
                why = (
                    "no more images come: is it still switched on?" if found else self.line.source.complaint()
                )
                raise PortError(where, f"{where} cannot be read: {why}")
        return np.array(found[:frames])

    def kPa(self, raw: Image) -> NDArray[np.float64]:
        """Pressures of a raw image; of a dead cell 0."""
        rise = raw - self.air
        if self.curves is None:
            return rise * (self._full_kPa / self.line.source.FULL_RAW)
        a, b = self.curves
        return a * np.sign(rise) * np.abs(rise) ** b

    def packed(self, raw: Image) -> bytes:
        """A raw image as the firmware's sensors would say it."""
        counts = geometry.PEDESTAL_COUNTS + self.kPa(raw) * (
            1000 * geometry.FULL_COUNT / geometry.FULL_SCALE_PA
        )
        return pack(np.rint(counts).clip(0, geometry.FULL_COUNT))

    def remark(self) -> str:
        """What is to be said of its pressures."""
        if not self.kept.air:
            note = "its zero is what it read when it was opened"
        else:
            note = f"its zero is {(time.time() - self.kept.zeroed) / 60:.0f} min old"
        if not self.kept.points:
            note += f", its kPa are a guess ({self._full_kPa:g} kPa at full scale)"
        return f"{note}; palpate calibrate mends both" if not self.kept.points else note


class _Board:
    """See firmware_py/boards/__init__.py for what each member does."""

    def __init__(self, reading: Reading, name: str) -> None:
        self.reading = reading
        self.serial = hashlib.sha256(name.encode()).digest()[:8]
        self.boots = 1
        self.settings_record = None
        self.images: deque[tuple[bytes, float, int]] = deque(maxlen=512)
        self.now, self.now_us = b"", 0.0
        self.encoder = reading.line.encoder
        self._place_um = 0, 0
        self.inbox, self.outbox = bytearray(), bytearray()
        self.turn = threading.Condition()

    def ticks_us(self) -> int:
        return time.monotonic_ns() // 1000 & _MASK

    def idle(self, us: int) -> None:
        """Look at the array, and no longer than a command may wait."""
        for raw, time_us, missed in self.reading.next(0.0 if self.images else min(us / 1e6, LOOK_S)):
            self.images.append((self.reading.packed(raw), time_us, missed))
        if self.encoder is not None:
            self.encoder.look(time.monotonic_ns() / 1000)

    def take(self) -> tuple[int, int]:
        """The next image is there: its time, and how many seem lost before it."""
        self.now, time_us, missed = self.images.popleft()
        if self.encoder is not None:
            place, depth = (round(1000 * mm) for mm in self.encoder.at(time_us))
            self._place_um = place, depth
        return int(time_us) & _MASK, missed

    def read(self, buffer: bytearray) -> int:
        with self.turn:
            n = min(len(buffer), len(self.inbox))
            buffer[:n] = self.inbox[:n]
            del self.inbox[:n]
        return n

    def write(self, buffer: bytearray, start: int, stop: int) -> int:
        with self.turn:
            if len(self.outbox) > _NOBODY_READS:
                return 0
            self.outbox += memoryview(buffer)[start:stop]
            self.turn.notify_all()
        return stop - start

    def begin(self) -> None:
        self.images.clear()

    def end(self) -> None:
        pass

    def start_scan(self) -> None:
        pass

    def scanned(self) -> bool:
        return True

    def scan(self, counts: memoryview) -> None:
        counts[:] = self.now

    def position_um(self) -> int:
        return self._place_um[0]  # 0: a press alone

    def displacement_um(self) -> int:
        return self._place_um[1]


class _Brain(estimator.Estimator):  # type: ignore[misc]
    """Has no calibration where none is kept, and takes none: `palpate calibrate` keeps it here."""

    def __init__(self, kept: Kept) -> None:
        self._folder = tempfile.TemporaryDirectory()  # nothing is written: what is kept is `Kept`
        super().__init__(store.FileStore(self._folder.name), None)
        self._calibrated = bool(kept.points)
        if len(dead := kept.dead):
            self.calibration.set_dead(dead.tolist())

    def _read_back(self, fields: tuple[int, ...]) -> tuple[int, tuple[int, ...], bytes]:
        return super()._read_back(fields) if self._calibrated else (status.NOT_SUPPORTED, (), b"")

    def _calibrate(self, fields: tuple[int, ...]) -> tuple[int, tuple[int, ...], bytes]:
        return status.NOT_SUPPORTED, (), b""


class _Acquire(acquire.Acquire):  # type: ignore[misc]
    """A frame is due when an image has come, and of its time."""

    def wait_us(self, now_us: int) -> int:
        return 0 if self._board.images else 1_000_000

    def begin(self, now_us: int) -> None:
        self._begun_us, missed = self._board.take()
        self._begun_um = self._board.position_um()
        self.seq = (self.seq + missed) & _MASK  # the host counts them as lost
        self.under_way = True


class Bridge:
    """A `Transport` at whose other end the firmware runs over an array.

    Parameters
    ----------
    line : OpenArray
        Open; the bridge closes it.
    """

    def __init__(self, line: OpenArray) -> None:
        self.name = line.source.address.text
        self._line = line
        self._failure: LinkError | None = None
        self._closed = threading.Event()
        try:
            reading = Reading(line)
        except BaseException:
            line.close()
            raise
        self._board = _Board(reading, line.source.address.name)
        self._thread = threading.Thread(target=self._run, name="array", daemon=True)
        self._thread.start()

    def read(self, timeout_s: float) -> bytes:
        """What the firmware has said within `timeout_s`; b"" if nothing."""
        board = self._board
        with board.turn:
            board.turn.wait_for(lambda: board.outbox or self._failure or self._closed.is_set(), timeout_s)
            data = bytes(board.outbox)
            board.outbox.clear()
        if not data and self._closed.is_set():
            raise LinkGone(f"{self.name} was closed")
        if not data and self._failure is not None:
            raise self._failure
        return data

    def write(self, data: bytes) -> None:
        """Say something to the firmware."""
        if self._failure is not None:
            raise self._failure
        with self._board.turn:
            self._board.inbox += data

    def close(self) -> None:
        """Give the port back."""
        if not self._closed.is_set():
            self._closed.set()
            with self._board.turn:
                self._board.turn.notify_all()
            self._thread.join()
            self._line.close()

    def _run(self) -> None:
        board = self._board
        device = probe.Probe(board, _Brain(board.reading.kept))
        device.acquire = _Acquire(board, device.counts, device.settings.values)
        rate_mHz = round(1e9 / max(board.reading.steady.period_us, 100.0))
        device.settings.values[settings.FRAME_RATE] = max(rate_mHz, 100)
        source = self._line.source
        device.log(messages.LOG_INFO, f"{source.address.scheme}: its frames bring no {source.LACKS}")
        encoder = board.encoder
        where = "a press only" if encoder is None else f"places and depths are of {encoder.name}"
        device.log(messages.LOG_INFO, f"times are steadied here, losses guessed from them; {where}")
        device.log(
            messages.LOG_INFO if board.reading.kept.points else messages.LOG_WARNING, board.reading.remark()
        )
        watch, gaps = _Watch(board.reading), _Gaps()
        slips = source.slips  # the first frame may have been cut
        try:
            while not self._closed.is_set():
                board.idle(device.step())
                if source.slips > slips:
                    slips = source.slips
                    device.log(
                        messages.LOG_WARNING, f"frames slipped {slips} times: bytes lost, or it was reset"
                    )
                if encoder is not None and (words := gaps.look(encoder)):
                    device.log(messages.LOG_WARNING, words)
                if words := watch.look(board):
                    device.log(messages.LOG_WARNING, words)
        except LinkError as error:
            self._failure = error
            with board.turn:
                board.turn.notify_all()


class _Gaps:
    """Tells when frames have begun or ceased to lack a place, and of lines that are none."""

    def __init__(self) -> None:
        self._without, self._odd, self._first = 0, 0, 0
        self._ends_us = 0.0

    def look(self, encoder: PlaceSource) -> str:
        """What is to be told now; "" mostly."""
        now_us = time.monotonic_ns() / 1000
        if encoder.without > self._without:
            begins = not self._ends_us
            self._first = self._without if begins else self._first
            self._without, self._ends_us = encoder.without, now_us + GAP_US
            return f"no places from {encoder.name}: frames keep the last" if begins else ""
        if self._ends_us and now_us > self._ends_us:
            self._ends_us = 0.0
            return f"places again; {self._without - self._first} frames had none of their own"
        if encoder.odd > self._odd and encoder.odd & (encoder.odd - 1) == 0:  # the 1st, 2nd, 4th, 8th...
            self._odd = encoder.odd
            return f"{encoder.odd} lines of {encoder.name} are no places"
        return ""


class _Watch:
    """Tells of the zero's drift while nothing touches the array."""

    EVERY_S = 1.0
    _TOUCHED_KPA = 0.3

    def __init__(self, reading: Reading) -> None:
        self._reading = reading
        self._seen: deque[tuple[float, NDArray[np.float64]]] = deque(maxlen=int(WATCH_S / self.EVERY_S))
        self._next_s = time.monotonic()

    def look(self, board: _Board) -> str:
        """What is to be told now; "" mostly."""
        now_s = time.monotonic()
        if now_s < self._next_s or not board.now:
            return ""
        self._next_s = now_s + self.EVERY_S
        kPa = NOMINAL.kPa_of(board.now).astype(float).ravel()
        if self._seen and abs(kPa - self._seen[0][1]).max() > self._TOUCHED_KPA:
            self._seen.clear()
        self._seen.append((now_s, kPa))
        if len(self._seen) < (self._seen.maxlen or 0):
            return ""
        times_s, cells = zip(*self._seen)
        found = drift(np.array(times_s), np.array(cells))
        self._seen.clear()
        if abs(found.Pa_per_minute) < DRIFT_PA:
            return ""
        return (
            f"its zero drifts by {found.Pa_per_minute:+.0f} Pa a minute; "
            f"calibrate zero again every {found.recalibrate_after_min():.0f} min"
        )


@contextmanager
def reading_of(line: OpenArray) -> Iterator[Reading]:
    """A line's reading, and its end."""
    try:
        yield Reading(line)
    finally:
        line.close()

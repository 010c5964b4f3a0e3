"""Other people's arrays without hardware: simulated pressures on FlexiTac's or ReSkin's wire.

Cells answer as piezoresistive ones do, with a power of the pressure: a calibration has something to find.
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from palpate.errors import UsageError
from palpate.sim.probe.endpoints import Endpoint
from palpate.sources import flexitac, reskin
from palpate.wire.cells import FULL_SCALE_KPA, SHAPE

Floats = NDArray[np.float64]
AIR = 20.0
"""What a cell of FlexiTac reads in the air."""
EXPONENT = 0.6
UT_A_KPA = 60.0
AIR_FRAMES = 100
FIELD_UT = np.array([35.0, -12.0, 410.0])
"""Of ReSkin's magnetometers in the air."""


def as_flexitac(kPa: Floats) -> bytes:
    """Pressures (rows, columns) in FlexiTac's frame."""
    share = np.clip(kPa / FULL_SCALE_KPA, -1, 1)  # in the air it is noise, to either side
    return flexitac.frame(AIR + (255 - AIR) * np.sign(share) * np.abs(share) ** EXPONENT)


def as_reskin(kPa: Floats) -> bytes:
    """Pressures in ReSkin's frame: each magnetometer feels the mean over its cells."""
    if SHAPE != (reskin.CELLS, reskin.CELLS):
        raise UsageError("ReSkin has 8 x 8 cells here: begin with palpate --array 8x8@2.5mm emulate")
    near = reskin.nearest(reskin.ReSkin.ORDER)
    mean = np.array([kPa[near == k].mean() for k in range(reskin.SENSORS)])
    return reskin.frame(FIELD_UT + np.outer(mean, [0.1, 0.2, -UT_A_KPA]))


WIRES: dict[str, Callable[[Floats], bytes]] = {"flexitac": as_flexitac, "reskin": as_reskin}


class Speaker:
    """Sends images on an array's wire for ever, from a thread; use as a context manager.

    Parameters
    ----------
    endpoint : Endpoint
        Where somebody may listen; closed with it.
    wire : callable
        Turns pressures (rows, columns), kPa, into bytes.
    images_kPa : iterable
        Sent one after the other, then again; from the beginning where nobody has listened.
    rate_Hz : float
    """

    def __init__(
        self,
        endpoint: Endpoint,
        wire: Callable[[Floats], bytes],
        images_kPa: Iterable[Floats],
        rate_Hz: float = 50.0,
    ) -> None:
        self.port = endpoint.port
        self._endpoint, self._period_s = endpoint, 1 / rate_Hz
        self._wire, self._images, self._next = wire, list(images_kPa), 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Speaker:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Unplug it; harmless when repeated."""
        if not self._stop.is_set():
            self._stop.set()
            self._thread.join()
            self._endpoint.close()

    def show(self, images_kPa: Iterable[Floats]) -> None:
        """Send these from now on."""
        self._images, self._next = list(images_kPa), 0

    def _run(self) -> None:
        due_s = time.monotonic()
        while not self._stop.wait(max(0.0, due_s - time.monotonic())):
            due_s += self._period_s
            waiting = self._endpoint.waiting()
            if waiting and select.select(waiting, [], [], 0)[0]:
                self._endpoint.accept()
            self._endpoint.look_after()
            if (fd := self._endpoint.fd) is not None:
                images = self._images
                data = self._wire(images[self._next % len(images)])
                self._next += 1
                try:
                    while data:
                        data = data[os.write(fd, data) :]
                except BlockingIOError:  # nobody reads: whoever comes sees it from the beginning
                    self._next = 0
                except (BrokenPipeError, ConnectionResetError):
                    self._endpoint.hang_up()


def felt_over(code: str, noise: str, seed: int, frames: int, strokes: int, still: bool) -> list[Floats]:
    """Air, then what the cells feel of presses and strokes over a lump: images (rows, columns), kPa."""
    from palpate.sim.probe.over_lump import strokes_over

    streams, _ = strokes_over(code, noise, seed, frames, strokes, still=still)
    return [np.zeros(SHAPE)] * AIR_FRAMES + [image for s in streams for image in _felt(s.counts)]


def felt_in_presses(code: str, noise: str, seed: int, presses: int, beside_mm: float) -> list[Floats]:
    """The same of presses alone; the hand lifts after each."""
    from palpate.sim.probe.over_lump import presses_over

    streams = presses_over(code, noise, seed, presses, beside_mm)
    return [image for s in streams for image in _felt(s.counts)]


def felt_under_a_cuff(code: str, noise: str, seed: int, pressure_kPa: float) -> list[Floats]:
    """What the same cells feel of one pressure everywhere."""
    from palpate.sim.probe.over_lump import cuffed

    return _felt(cuffed(code, noise, seed, pressure_kPa, AIR_FRAMES))


def _felt(counts: Iterable[Floats]) -> list[Floats]:
    from palpate.wire.scale import NOMINAL

    return [NOMINAL.kPa(each.astype(np.uint16)).astype(float) for each in counts]

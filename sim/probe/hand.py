"""What a hand does with the reference probe in a circuit: it turns the wheel and presses. Times in us."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from firmware_py import geometry
from palpate.sim.probe import source
from palpate.sim.probe.circuit import FULL, Matrix
from palpate.wire.packing import unpack

TRAVEL_UM = 25_000  # of the potentiometer
STEP_UM = 25  # a quarter step of the encoder
PERIOD_US = 1e6 / source.FRAMES_PER_S  # from one moment to the next
TICK_US = 100.0  # between two looks at where the wheel should be; a step in each at most: 250 mm/s
_CYCLE = ((0, 0), (1, 0), (1, 1), (0, 1))  # A, B


class Moment(NamedTuple):
    """A frame's worth of a hand: the cells' counts, where the wheel is, how deep the probe is (um)."""

    cells: np.ndarray
    position_um: int
    depth_um: int


def moments(records_: bytes) -> list[Moment]:
    """What a source file (palpate.sim.probe.source) says, a stroke going on where the one before ended.

    In such a file every stroke has positions of its own, and the air between two has none.
    """
    found: list[Moment] = []
    at = shift = 0
    lifted = True
    for k in range(0, len(records_), source.RECORD_BYTES):
        record = records_[k : k + source.RECORD_BYTES]
        position, depth = struct.unpack_from("<ii", record)
        cells = unpack(record[8:])
        if record[8:] == source.lifted_record()[8:]:
            lifted = True
        else:
            if lifted:
                shift, lifted = at - position, False
            at = position + shift
        found.append(Moment(cells, at, depth))
    return found


class Hand:
    """Moves a probe through moments at a steady rate, once the probe has begun to stream.

    Parameters
    matrix: what it presses
    way: the moments
    repeat: begin again after the last
    """

    def __init__(self, matrix: Matrix, way: Sequence[Moment] = (), repeat: bool = False) -> None:
        self._matrix = matrix
        self._repeat = repeat
        self._air = np.full(geometry.CELLS, geometry.PEDESTAL_COUNTS)
        self._frames = list(way)
        self.began_us: float | None = None
        self.steps = 0  # of the wheel so far
        self._base_um = 0
        self._round = 0
        self._shown = -1
        self._rest()

    def _rest(self) -> None:
        self._matrix.cells = self._air
        self._matrix.displacement_counts = 0

    def take(self, way: Sequence[Moment]) -> None:
        """From the next stream on, go this way."""
        self._frames = list(way)
        self.end()

    def begin(self, now_us: float) -> None:
        """The first stroke begins now."""
        self.began_us = now_us
        self._base_um = self.steps * STEP_UM
        self._round = 0
        self._shown = -1

    def end(self) -> None:
        """The probe is lifted and held still."""
        self.began_us = None
        self._rest()

    @property
    def at_rest(self) -> bool:
        """True before the first stroke and after the last."""
        return self.began_us is None or not self._frames

    def tick(self, now_us: float) -> tuple[int, int]:
        """Move on to now; levels of A and B."""
        if not self.at_rest:
            assert self.began_us is not None
            time = (now_us - self.began_us) / PERIOD_US
            k = int(time)
            n = len(self._frames)
            if k // n > self._round:
                if self._repeat:
                    self._round = k // n
                    self._base_um = self.steps * STEP_UM
                else:
                    self.end()
                    return _CYCLE[self.steps % 4]
            k %= n
            cells, place, depth = self._frames[k]
            if k != self._shown:
                self._shown = k
                self._matrix.cells = cells
                self._matrix.displacement_counts = depth * FULL / TRAVEL_UM
            following = self._frames[min(k + 1, n - 1)].position_um
            target = self._base_um + place + (following - place) * (time % 1)
            if target - self.steps * STEP_UM >= STEP_UM:
                self.steps += 1
            elif self.steps * STEP_UM - target >= STEP_UM:
                self.steps -= 1
        return _CYCLE[self.steps % 4]

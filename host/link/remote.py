"""What a live probe can be told: commands, settings, calibration, clocks; the base of `Probe`."""

from __future__ import annotations

import random
import time
from dataclasses import dataclass
from typing import Any

from firmware_py import messages, status
from host.errors import CommandRefused, NotLive
from host.link.accounting import Counts
from host.link.clock import ClockState, ClockSync
from host.link.commands import setting_key
from host.link.identity import Identity
from host.link.line import GIVE_UP_S, Line
from host.link.parser import LiveParser
from host.link.scale import CellScale

BUSY_TRIES, BUSY_WAIT_S = 20, 0.1
READ_BACK_S = 30.0
"""For a piece read back: its answer is four times as long as others, so a bad line eats it more often."""
CALIBRATE_S = 30.0


@dataclass(frozen=True)
class Calibrated:
    """What a calibration on the probe found: frames used, dead cells, mean noise of the cells in counts."""

    frames: int
    dead_cells: int
    noise_counts: float


class Commandable:
    """The commands of a client; `Probe` adds the events.

    Parameters
    ----------
    name : str
        Of the port or recording, for errors.
    line : Line or None
        The live line; None for a recording, which takes no commands.
    """

    def __init__(self, name: str, line: Line | None) -> None:
        self._name = name
        self._line = line
        self._parser = LiveParser() if line is None else line.parser
        self._sync = ClockSync()
        self._sync_restarts = 0
        self._identity: Identity | None = None

    @property
    def frame_counts(self) -> Counts:
        """Frames received, lost, duplicate, late."""
        return self._parser.frames.counts

    @property
    def clock(self) -> ClockState | None:
        """Offset and drift of the probe's clock; None before `sync_clock`."""
        return self._sync.state

    def command(
        self,
        name: str,
        *values: int,
        tail: bytes = b"",
        timeout_s: float = GIVE_UP_S,
        once: bool = False,
    ) -> tuple[Any, ...]:
        """Give a command and wait for its answer; the same bytes are sent again until it comes.

        Parameters
        ----------
        name : str
            Of `firmware_py.messages.COMMANDS`.
        values, tail
            Its fields, in order.
        timeout_s : float
            How long to go on before the probe counts as silent, s (while unplugged the clock stands still).
        once : bool
            Do not send it again.

        Returns
        -------
        tuple
            The answer's fields.

        Raises
        ------
        CommandTimeout
            No answer in that time.
        CommandRefused
            The probe's status was negative (after two seconds of tries, if it was busy).
        LinkGone
            The port vanished and does not come back.
        NotLive
            The source is a recording.
        """
        line = self._live(name)
        for _ in range(BUSY_TRIES):
            try:
                return line.ask(name, values, tail, timeout_s, once).values
            except CommandRefused as refusal:
                # The probe remembers its refusal of this id; the next try has an id of its own.
                if refusal.status != status.BUSY:
                    raise
                time.sleep(BUSY_WAIT_S)
        return line.ask(name, values, tail, timeout_s, once).values

    def sync_clock(self, exchanges: int = 8) -> ClockState:
        """Compare the clocks a few times; more often, and over longer, makes the drift better.

        Returns
        -------
        ClockState
            Offset, drift and their doubt.
        """
        line = self._live("time_sync")
        if self._sync_restarts != self.frame_counts.restarts:
            self._sync_restarts = self.frame_counts.restarts
            self._sync.restart()
        for _ in range(exchanges):
            answer = line.ask_afresh("time_sync")
            asked_ns, taken_us, answered_us = line.asked_ns, *answer.values
            self._sync.add(asked_ns / 1000, taken_us, answered_us, answer.host_ns / 1000)
        state = self._sync.state
        assert state is not None
        return state

    def host_time_us(self, probe_us: int) -> float | None:
        """Unix time, us, of an event's `time_us`; None before `sync_clock` and after a restart."""
        if self._sync_restarts != self.frame_counts.restarts:
            return None
        return self._sync.host_time_us(probe_us)

    def statistics(self) -> dict[str, int]:
        """The probe's own counters, by the names of `firmware_py.messages.COUNTERS`."""
        (values,) = self.command("statistics")
        return dict(zip(messages.COUNTERS, values))

    def get_setting(self, name: str) -> int:
        """A setting's value, in the unit of its table row (docs/protocol.md)."""
        return int(self.command("get_setting", setting_key(name))[1])

    def set_setting(self, name: str, value: int) -> None:
        """Set and store a setting; `CommandRefused` where it is outside its limits."""
        self.command("set_setting", setting_key(name), value)

    def calibrate_zero(self, frames: int = 100) -> Calibrated:
        """Take what the cells read now, in the air, as their zero; stored on the probe."""
        return self._calibrate(messages.CALIBRATE_ZERO, frames, 0.0)

    def calibrate_gain(self, pressure_kPa: float, frames: int = 100) -> Calibrated:
        """Set every cell's gain under a uniform pressure; cells that do not answer are marked dead."""
        return self._calibrate(messages.CALIBRATE_GAIN, frames, pressure_kPa)

    def forget_calibration(self) -> Calibrated:
        """Back to the calibration that the firmware was born with."""
        return self._calibrate(messages.CALIBRATE_CLEAR, 0, 0.0)

    def _calibrate(self, kind: int, frames: int, pressure_kPa: float) -> Calibrated:
        words = (kind, frames, round(1000 * pressure_kPa))
        _, taken, dead, noise = self.command("calibrate", *words, timeout_s=CALIBRATE_S)
        self.read_back(messages.READ_CALIBRATION)  # from here on frames are decoded with it
        return Calibrated(taken, dead, noise / 1000)

    @property
    def scale(self) -> CellScale:
        """What frames are decoded with: the probe's own calibration, or (not `calibrated`) the nominal."""
        return self._parser.scale

    def learn_calibration(self) -> None:
        """Read the probe's calibration unless it is known; a probe without one leaves the nominal scale."""
        if not self.scale.calibrated:
            self.read_back(messages.READ_CALIBRATION)  # the parser takes it from the answers

    def refresh_identity(self) -> Identity:
        """Shake hands again: what the probe is now (after a flash: which model is live)."""
        self._identity = self._identify()
        if self._line is not None:
            self._line.identity = self._identity
        return self._identity

    def read_back(self, what: int) -> bytes:
        """The stored calibration (0) or the live model image (1), bit for bit; b"" where there is none."""
        found = b""
        while True:
            try:
                _, offset, size, piece = self.command("read_back", what, len(found), timeout_s=READ_BACK_S)
            except CommandRefused as refusal:
                if refusal.status in (status.NO_MODEL, status.NOT_SUPPORTED, status.BAD_TYPE):
                    return b""
                raise
            if offset == len(found):
                found += piece
            if len(found) >= size or not piece:
                return found

    def _live(self, command: str) -> Line:
        if self._line is None:
            raise NotLive(f"{self._name} is a recording: it cannot be given the command {command}")
        return self._line

    def _identify(self) -> Identity:
        nonce = random.randrange(1 << 30)
        return Identity.from_answer(self.command("identify", nonce))

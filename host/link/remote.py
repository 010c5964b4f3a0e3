"""Commands to a live probe: settings, calibration, clocks; the base of `Probe`."""

from __future__ import annotations

import random
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from firmware_py import messages, status
from palpate.errors import CommandRefused, Contradiction, LinkError, UsageError
from palpate.link.commands import setting_key
from palpate.link.line import GIVE_UP_S, Line
from palpate.wire.clock import ClockState, ClockSync
from palpate.wire.identity import Identity
from palpate.wire.reference import Reference
from palpate.wire.source import EventSource

BUSY_TRIES, BUSY_WAIT_S = 20, 0.1
READ_BACK_S = 30.0
"""For a piece read back: its answer is four times as long as others, so a bad line loses it more often."""
CALIBRATE_S = 30.0
LONGEST_READ = 1 << 16
"""Bytes; no probe holds a calibration or a model as long."""
STRAY_TRIES = 20
REFERENCE_FRAMES = 3000
"""The probe itself gives up after so many (firmware_py.reference)."""
_INTEGER = 1 << 31
OF_THIS_MOMENT = ("uptime_ms", "free_bytes", "estimates_waiting")
"""Of `statistics`, what is no count."""


@dataclass(frozen=True)
class Calibrated:
    """What a calibration on the probe found: frames used, dead cells, mean noise of the cells in counts."""

    frames: int
    dead_cells: int
    noise_counts: float


class Commandable(EventSource):
    """The commands of a client; `Probe` adds the events.

    Parameters
    ----------
    line : Line
    """

    live = True

    def __init__(self, line: Line) -> None:
        super().__init__(line.transport.name, line.parser)
        self._line = line
        self._sync = ClockSync(times_slower=line.times_slower)
        self._sync_restarts = 0
        self._counts_before: tuple[int, dict[str, int]] = 0, {}

    @property
    def times_slower(self) -> float:
        """Seconds of this computer that one of the probe's takes: 1, or many for an emulated board."""
        return self._line.times_slower

    @property
    def clock(self) -> ClockState | None:
        """Offset and drift of the probe's clock; None before `sync_clock`."""
        return self._sync.state

    def command(
        self,
        name: str,
        *values: int | bytes,
        tail: bytes = b"",
        timeout_s: float = GIVE_UP_S,
        once: bool = False,
    ) -> tuple[Any, ...]:
        """Send a command and wait for its answer; the same bytes are sent again until it comes.

        Parameters
        ----------
        name : str
            Of `firmware_py.messages.COMMANDS`.
        values, tail
            Its fields, in order.
        timeout_s : float
            How long to try before the probe counts as silent, in its seconds (time spent unplugged does not
            count).
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
        """
        line = self._line
        for _ in range(BUSY_TRIES):
            try:
                return line.ask(name, values, tail, timeout_s, once).values
            except CommandRefused as refusal:
                # The probe remembers its refusal of this id; the next try has an id of its own.
                if refusal.status != status.BUSY:
                    raise
                time.sleep(BUSY_WAIT_S * line.times_slower)
        return line.ask(name, values, tail, timeout_s, once).values

    def sync_clock(self, exchanges: int = 8) -> ClockState:
        """Compare the clocks a few times; more often, and over longer, makes the drift better.

        Returns
        -------
        ClockState
            Offset, drift and their uncertainty.
        """
        line = self._line
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

    def begin_counting(self) -> None:
        """From here on `session_statistics` counts: the probe itself counts since it was switched on."""
        with suppress(LinkError):
            self._counts_before = self._identified_boots(), self.statistics()

    def session_statistics(self) -> dict[str, int]:
        """`statistics` since `begin_counting`; what is of this moment (uptime, memory, waiting) as it is."""
        now = self.statistics()
        boots, before = self._counts_before
        if boots != self._identified_boots():
            return now  # it was switched off and on meanwhile: it has counted from nothing
        return {
            name: value if name in OF_THIS_MOMENT else (value - before.get(name, 0)) % messages.WRAP
            for name, value in now.items()
        }

    def _identified_boots(self) -> int:
        return self._line.identity.boots if self._line.identity is not None else 0

    def get_setting(self, name: str) -> int:
        """A setting's value, in the unit of its table row (docs/protocol.md)."""
        return int(self.command("get_setting", setting_key(name))[1])

    def set_setting(self, name: str, value: int) -> None:
        """Set and store a setting; `CommandRefused` where it is outside the limits that it has now."""
        key = setting_key(name)
        try:
            if not -_INTEGER <= value < _INTEGER:  # the wire carries no such number
                raise CommandRefused("set_setting", status.BAD_VALUE, "")
            self.command("set_setting", key, value)
        except CommandRefused as refusal:
            if refusal.status != status.BAD_VALUE:
                raise
            lowest, highest = self.setting_limits(name)
            unit = messages.SETTINGS[key][2]
            message = f"{name} takes {lowest} to {highest} {unit}, not {value}"
            raise CommandRefused("set_setting", refusal.status, message) from refusal

    def setting_limits(self, name: str) -> tuple[int, int]:
        """Lowest and highest value that a setting takes now (force_low stays below force_high)."""
        _, _, lowest, highest = self.command("get_setting", setting_key(name))
        return int(lowest), int(highest)

    def calibrate_zero(self, frames: int = 100) -> Calibrated:
        """Take the cells' present readings, in the air, as their zero; stored on the probe."""
        return self._calibrate(messages.CALIBRATE_ZERO, frames, 0.0)

    def calibrate_gain(self, pressure_kPa: float, frames: int = 100) -> Calibrated:
        """Set every cell's gain under a uniform pressure; cells that do not answer are marked dead."""
        if not 0 < 1000 * pressure_kPa < _INTEGER:
            raise UsageError(f"a pressure of {pressure_kPa:g} kPa is none to calibrate with")
        return self._calibrate(messages.CALIBRATE_GAIN, frames, pressure_kPa)

    def forget_calibration(self) -> Calibrated:
        """Back to the factory default calibration."""
        return self._calibrate(messages.CALIBRATE_CLEAR, 0, 0.0)

    def _calibrate(self, kind: int, frames: int, pressure_kPa: float) -> Calibrated:
        words = (kind, frames, round(1000 * pressure_kPa))
        rate_Hz = self.get_setting("frame_rate") / 1000
        patience_s = CALIBRATE_S + 1.5 * frames / rate_Hz
        _, taken, dead, noise = self.command("calibrate", *words, timeout_s=patience_s)
        self.read_back(messages.READ_CALIBRATION)  # from here on frames are decoded with it
        return Calibrated(taken, dead, noise / 1000)

    def take_reference(self) -> Reference:
        """Wait for one press beside the lump, from the air straight down and up again; it is kept.

        Until another is taken, `clear_reference`, another model or calibration, or the power goes.

        Raises
        ------
        CommandRefused
            The model takes none, a stream runs, or the press will not do; the sentence says which.
        """
        rate_Hz = self.get_setting("frame_rate") / 1000
        patience_s = CALIBRATE_S + 1.5 * REFERENCE_FRAMES / rate_Hz
        found = self.command("reference", messages.REFERENCE_TAKE, timeout_s=patience_s)
        reference = Reference.from_answer(found)
        assert reference is not None
        return reference

    def clear_reference(self) -> None:
        """Forget the reference press: strokes count alone."""
        self.command("reference", messages.REFERENCE_CLEAR)

    def reference(self) -> Reference | None:
        """The reference press that the probe keeps; None where it has none, or never heard of any."""
        try:
            return Reference.from_answer(self.command("reference", messages.REFERENCE_TELL))
        except CommandRefused as refusal:
            if refusal.status in (status.NOT_SUPPORTED, status.BAD_TYPE):
                return None
            raise

    def learn_calibration(self) -> None:
        """Read the probe's calibration unless it is known; a probe without one leaves the nominal scale."""
        if not self.scale.calibrated:
            self.read_back(messages.READ_CALIBRATION)  # the parser takes it from the answers

    def refresh_identity(self) -> Identity:
        """Shake hands again, to learn what the probe is now (after a flash: which model is live)."""
        nonce = random.randrange(1 << 30)
        self._line.identity = identity = Identity.from_answer(self.command("identify", nonce))
        return identity

    def read_back(self, what: int, enough: int | None = None) -> bytes:
        """The stored calibration (0) or the live model image (1), bit for bit; b"" where there is none.

        `enough`: so many bytes will do, from its beginning.
        """
        found = b""
        strayed, first = 0, None
        while True:
            try:
                _, offset, size, piece = self.command("read_back", what, len(found), timeout_s=READ_BACK_S)
            except CommandRefused as refusal:
                if refusal.status in (status.NO_MODEL, status.NOT_SUPPORTED, status.BAD_TYPE):
                    return b""
                raise
            first = size if first is None else first
            if offset == len(found) and size == first:
                found += piece
            elif (strayed := strayed + 1) > STRAY_TRIES:
                raise Contradiction(
                    f"{self.name} answers with other bytes than those asked for; reset the probe"
                )
            if not 0 <= size <= LONGEST_READ:
                raise Contradiction(f"{self.name} says that it holds {size} bytes, more than any probe has")
            if len(found) >= (size if enough is None else min(size, enough)) or not piece:
                return found

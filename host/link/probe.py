"""The client: one class for a real port, an emulated probe and a recording.

    with Probe.open("auto") as probe:
        print(probe.identity.serial)
        for event in probe.stream(strokes=3):
            match event:
                case Estimate():
                    print(event.as_dict())

The program takes events from a bounded queue at its own pace (frames that it is too slow for are dropped,
oldest first, and counted; the recording has them all). After an unplug the stream goes on, with a `Gap`.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator
from typing import Any, Self

from firmware_py import messages, status
from host.errors import CommandRefused, CommandTimeout, LinkGone, NotAProbe, NotLive
from host.link.accounting import Counts
from host.link.clock import ClockState, ClockSync
from host.link.commands import setting_key
from host.link.events import Answer, Estimate, Event, Gap
from host.link.identity import Identity
from host.link.line import GIVE_UP_S, Line, Recorder
from host.link.parser import Again, LinkCounts, LiveParser
from host.link.transport import Transport

BUSY_TRIES, BUSY_WAIT_S = 20, 0.1
READ_BACK_S = 30.0
"""For a piece read back: its answer is four times as long as others, so a bad line eats it more often."""


class Probe:
    """A probe at the other end of a transport, past its handshake.

    Parameters
    ----------
    transport : Transport
        An open link; the client owns it from here on.
    recorder : Recorder, optional
        Is told every byte of the wire, both ways, and every event.
    reopen : callable, optional
        Opens the link again after an unplug; without it a broken link ends the session.

    Raises
    ------
    NotAProbe
        The other end does not answer the handshake.
    VersionMismatch
        It speaks another protocol.
    """

    def __init__(
        self,
        transport: Transport,
        recorder: Recorder | None = None,
        reopen: Callable[[], Transport] | None = None,
    ) -> None:
        self._transport = transport
        self._line = Line(transport, recorder, reopen) if transport.live else None
        self._parser = LiveParser() if self._line is None else self._line.parser
        self._sync = ClockSync()
        self._sync_restarts = 0
        try:
            self._identity = self._handshake()
            self._identity.check()
        except BaseException:
            self.close()
            raise
        if self._line is not None:
            self._line.identity = self._identity

    @classmethod
    def open(cls, port: str = "auto", baud: int = 921_600, recorder: Recorder | None = None) -> Self:
        """Open a probe by name.

        Parameters
        ----------
        port : str
            `auto`, a device path, `COM5`, `socket://HOST:PORT`, a serial number, or a recording's file.
        baud : int
            Of a UART.
        recorder : Recorder, optional
            Where the session is recorded.

        Raises
        ------
        PortError
            Busy, forbidden, missing or ambiguous; the sentence says what to do.
        NotAProbe, VersionMismatch
            Something else answers, or nothing.
        """
        if port.endswith(".mcap"):
            from host.record.playback import PlaybackTransport

            return cls(PlaybackTransport(port))
        from host.link.devices import resolve
        from host.link.transport import open_transport

        place = resolve(port, baud)
        return cls(open_transport(place.port, baud), recorder, lambda: open_transport(place.port_now(), baud))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def name(self) -> str:
        """The port's or the recording's name."""
        return self._transport.name

    @property
    def live(self) -> bool:
        """False for a recording."""
        return self._line is not None

    @property
    def connected(self) -> bool:
        """False while the probe is unplugged; a recording is always there."""
        return self._line is None or self._line.connected

    @property
    def identity(self) -> Identity:
        """Who answered the last handshake."""
        return self._identity if self._line is None or self._line.identity is None else self._line.identity

    @property
    def counts(self) -> LinkCounts:
        """What this end counted of the link (`statistics` asks for the other end's)."""
        if self._line is not None:
            self._parser.counts.queue_dropped = self._line.events.dropped
        return self._parser.counts

    @property
    def frame_counts(self) -> Counts:
        """Frames received, lost, duplicate, late."""
        return self._parser.frames.counts

    @property
    def clock(self) -> ClockState | None:
        """Offset and drift of the probe's clock; None before `sync_clock`."""
        return self._sync.state

    def close(self) -> None:
        """Stop reading and close the port; harmless when repeated. The recorder stays open."""
        if self._line is not None:
            self._line.close()
        else:
            self._transport.close()

    # Commands

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

    # Events

    def start_stream(self, strokes: int = 0, every: int = 1, frames: bool = True) -> None:
        """Ask for frames and stroke results; after an unplug they are asked for again without a word.

        Parameters
        ----------
        strokes : int
            The probe stops by itself after so many; 0 never.
        every : int
            Send each n-th frame.
        frames : bool
            False: only states, maps and estimates.
        """
        line = self._live("stream_start")
        content = messages.CONTENT_STROKES
        content |= messages.CONTENT_FRAMES if frames else 0
        line.stream = (content, every, strokes)
        line.ask("stream_start", line.stream)

    def stop_stream(self) -> None:
        """Stop the stream; what is still on its way can be read from `events`."""
        line = self._live("stream_stop")
        line.stream = None
        line.ask("stream_stop")

    def events(self, timeout_s: float | None = None) -> Iterator[Event]:
        """Events as they come, until `timeout_s` passes without one, or the recording ends.

        Raises
        ------
        LinkGone
            The port vanished and cannot be opened again.
        """
        if self._line is None:
            yield from self._play()
            return
        while (event := self._line.events.get(timeout_s)) is not None:
            yield event
        if self._line.failure is not None:
            raise self._line.failure

    def stream(self, strokes: int = 0, every: int = 1, timeout_s: float | None = None) -> Iterator[Event]:
        """Start the stream, hand on its events, and stop it when `strokes` estimates have come (0: never).

        A recording plays from its beginning, as it came.
        """
        if self._line is None:
            yield from self._play()
            return
        self.start_stream(0, every)
        done = 0
        try:
            for event in self.events(timeout_s):
                yield event
                done += isinstance(event, Estimate)
                if strokes and done == strokes:
                    return
        finally:
            if self.connected:
                self.stop_stream()

    def _live(self, command: str) -> Line:
        if self._line is None:
            raise NotLive(f"{self.name} is a recording: it cannot be given the command {command}")
        return self._line

    def _play(self) -> Iterator[Event]:
        """A recording has no thread: it is read as fast as its reader goes."""
        while True:
            try:
                data = self._transport.read(0.0)
            except LinkGone:
                self._parser.settle()
                return
            if command := getattr(self._transport, "command", b""):
                self._parser.commanded(command)
            mark: Gap | None = getattr(self._transport, "mark", None)
            if mark is not None:
                yield mark
            for event in self._parser.feed(data, getattr(self._transport, "host_ns", 0)):
                if not isinstance(event, Answer | Again):
                    yield event

    # Handshake

    def _handshake(self) -> Identity:
        if self._line is None:
            values = getattr(self._transport, "identity", None)
            if values is None:
                raise NotAProbe(f"{self.name} holds no handshake; it is not a recording of a probe")
            return Identity.from_answer(values)
        try:
            return self._identify()
        except (CommandTimeout, CommandRefused) as error:
            raise NotAProbe(
                f"{self.name} does not answer as a Palpate probe; check the port (`palpate devices`) "
                "and that the firmware runs"
            ) from error

    def _identify(self) -> Identity:
        nonce = random.randrange(1 << 30)
        return Identity.from_answer(self.command("identify", nonce))

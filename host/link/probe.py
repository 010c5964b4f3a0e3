"""The client: one class for a real port and an emulated probe (`open_recording` plays what was recorded).

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

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Self

from firmware_py import messages, status
from palpate.errors import CommandRefused, NotLive
from palpate.link.devices import resolve
from palpate.link.handshake import shake_hands
from palpate.link.line import Line
from palpate.link.reader import POLL_S
from palpate.link.recorder import Recorder
from palpate.link.remote import Commandable
from palpate.link.stream_wish import StreamStart, StreamWish
from palpate.link.transport import Transport, open_transport
from palpate.wire.accounting import LinkCounts
from palpate.wire.delivery import Awaited
from palpate.wire.events import Estimate, Event, Frame
from palpate.wire.identity import Identity
from palpate.wire.results import Features, TactileMap

_log = logging.getLogger(__name__)

EARLIER_S = 10.0
"""How long the results of one earlier stream may take to come."""


class Probe(Commandable):
    """A probe at the other end of a transport, past its handshake.

    Parameters
    ----------
    transport : Transport
        An open link; the client owns it from here on.
    recorder : Recorder, optional
        Receives every byte of the wire, both ways, and every event.
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
        elsewhere: Callable[[], Transport] | None = None,
    ) -> None:
        super().__init__(Line(transport, recorder, reopen, elsewhere))
        try:
            shake_hands(self._line)
            _log.info("%s: %s", transport.name, self.identity)
        except BaseException:
            self.close()
            raise

    @classmethod
    def open(cls, port: str = "auto", baud: int = 921_600, recorder: Recorder | None = None) -> Self:
        """Open a probe by name.

        Parameters
        ----------
        port : str
            `auto`, a device path, `COM5`, `socket://HOST:PORT`, a serial number. With `auto` and no
            recorder a stream goes on with another probe if the first stays away.
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
        NotLive
            It is a recording's name.
        """
        if port.endswith(".mcap"):
            raise NotLive(f"{port} is a recording, not a port; `palpate view` and `palpate replay` take it")
        place = resolve(port, baud)

        def reopen() -> Transport:
            return open_transport(place.port_now(), baud)

        def elsewhere() -> Transport:
            return open_transport(resolve("auto", baud).port, baud)

        any_will_do = port == "auto" and recorder is None  # a recording is of one probe
        return cls(open_transport(place.port, baud), recorder, reopen, elsewhere if any_will_do else None)

    @property
    def connected(self) -> bool:
        """False while the probe is unplugged."""
        return self._line.connected

    @property
    def identity(self) -> Identity:
        """Who answered the last handshake."""
        identity = self._line.identity
        assert identity is not None
        return identity

    @property
    def counts(self) -> LinkCounts:
        """What this end counted of the link (`statistics` asks for the other end's)."""
        self._parser.counts.queue_dropped = self._line.events.dropped
        self._parser.counts.strokes_received = self._parser.strokes.received
        self._parser.counts.strokes_lost = self._parser.strokes.lost
        return self._parser.counts

    def check_recording(self) -> None:
        """Raise what ended the recording early (`DiskFull`), if anything did; the stream itself goes on."""
        if self._line.recorder is not None:
            self._line.recorder.check()

    def mark(self, event: Event) -> None:
        """Put an event of one's own into the recording, if there is one, at its `host_ns`."""
        if self._line.recorder is not None:
            self._line.recorder.mark(event)

    def close(self) -> None:
        """Stop reading and close the port; harmless when repeated. The recorder stays open."""
        self._line.close()

    # Events

    def start_stream(self, strokes: int = 0, every: int = 1, frames: bool = True) -> StreamStart:
        """Ask for frames and stroke results; after an unplug they are requested again automatically.

        The probe ends a stream whose client has not said a word for half a minute; this one's thread does.

        Parameters
        ----------
        strokes : int
            The probe stops by itself after so many; 0 never.
        every : int
            Send each n-th frame.
        frames : bool
            False: only states, maps and estimates.
        """
        line = self._line
        self.learn_calibration()
        content = messages.CONTENT_STROKES
        content |= messages.CONTENT_FRAMES if frames else 0
        wish = StreamWish(content, every, strokes)
        begun = line.ask("stream_start", wish.words).values
        wish.number, wish.renewed = begun[0], time.monotonic()
        line.stream = wish
        return StreamStart(*begun[:3])

    def renew_stream(self) -> None:
        """Say that this client is still there, as its thread does by itself; nothing where no stream runs.

        The answer tells a recording that has just begun which stream it is of.
        """
        line = self._line
        if line.stream is not None and line.stream.number:
            with suppress(CommandRefused):  # the probe has ended it; the thread begins another
                line.ask("stream_renew", (line.stream.number,))

    def earlier_results(self) -> list[Estimate | Features | TactileMap]:
        """Results of streams that other clients began and never took: fetched, and acknowledged.

        They are never part of `stream`'s events: whose stroke it was, and when, only that client knows.
        """
        line = self._line
        found: dict[tuple[type, int, int], Estimate | Features | TactileMap] = {}
        for stream in self._waiting_streams():
            self.command("results", stream)
            deadline = time.monotonic() + EARLIER_S * self.times_slower
            while stream in self._waiting_streams() and time.monotonic() < deadline:
                while line.earlier:
                    result = line.earlier.popleft()
                    found[type(result), result.stream, result.stroke] = result
                    line.acknowledge(result)
                time.sleep(POLL_S)
        return sorted(found.values(), key=lambda result: (result.stream, result.stroke))

    def stop_stream(self) -> None:
        """Stop the stream; what is still on its way can be read from `events`."""
        self._line.stream = None
        self._line.ask("stream_stop")

    def events(self, timeout_s: float | None = None) -> Iterator[Event]:
        """Events as they come, until `timeout_s` passes without one.

        Raises
        ------
        LinkGone
            The port vanished and cannot be opened again.
        """
        while (event := self._line.events.get(timeout_s)) is not None:
            yield event
        if self._line.failure is not None:
            raise self._line.failure

    def stream(self, strokes: int = 0, every: int = 1, timeout_s: float | None = None) -> Iterator[Event]:
        """Start the stream, pass on its events, and stop it when `strokes` estimates have come (0: never).

        `timeout_s`, in the probe's seconds: how long to wait for an event.
        """
        begun = self.start_stream(0, every)
        waits = Awaited(strokes, self.times_slower)
        if timeout_s is not None:
            timeout_s *= self.times_slower
        try:
            for event in self.events(timeout_s):
                if isinstance(event, Frame) and not waits.begun:
                    if (event.seq - begun.next_seq) % messages.WRAP >= messages.WRAP // 2:
                        continue  # of a stream that still ran when this one began
                    waits.begun = True
                yield event
                if waits.enough(event):
                    return
        finally:
            if self.connected:
                self.stop_stream()
            else:
                self._line.stream = None  # if the probe comes back, it is told to stop

    def _waiting_streams(self) -> set[int]:
        """Streams of other clients whose results the probe still holds."""
        try:
            listed = self.command("results", 0)[1]  # of each its number, its oldest and its newest stroke
        except CommandRefused as refusal:
            if refusal.status in (status.BAD_TYPE, status.NOT_SUPPORTED):
                return set()  # an older firmware
            raise
        return set(listed[::3]) - set(self._parser.streams)

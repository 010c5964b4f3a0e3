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

from collections.abc import Callable, Iterator
from typing import Self

from firmware_py import messages
from host.errors import LinkGone, NotAProbe
from host.link.accounting import LinkCounts
from host.link.devices import resolve
from host.link.events import Answer, Estimate, Event, Gap
from host.link.handshake import shake_hands
from host.link.identity import Identity
from host.link.line import Line
from host.link.recorder import Recorder
from host.link.remote import Commandable
from host.link.results import Again
from host.link.transport import Transport, open_transport


class Probe(Commandable):
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
        super().__init__(transport.name, Line(transport, recorder, reopen) if transport.live else None)
        self._transport = transport
        try:
            self._identity = shake_hands(self._line) if self._line is not None else self._recorded_identity()
        except BaseException:
            self.close()
            raise

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
        told = self._identity if self._line is None else self._line.identity
        assert told is not None
        return told

    @property
    def counts(self) -> LinkCounts:
        """What this end counted of the link (`statistics` asks for the other end's)."""
        if self._line is not None:
            self._parser.counts.queue_dropped = self._line.events.dropped
        return self._parser.counts

    def check_recording(self) -> None:
        """Raise what ended the recording early (`DiskFull`), if anything did; the stream itself goes on."""
        check = getattr(self._line.recorder, "check", None) if self._line is not None else None
        if check is not None:
            check()

    def close(self) -> None:
        """Stop reading and close the port; harmless when repeated. The recorder stays open."""
        if self._line is not None:
            self._line.close()
        else:
            self._transport.close()

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
        self.learn_calibration()
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
            else:
                self._line.stream = None  # should the probe come back, it is told to stop

    def _recorded_identity(self) -> Identity:
        values = getattr(self._transport, "identity", None)
        if values is None:
            raise NotAProbe(f"{self.name} holds no handshake; it is not a recording of a probe")
        identity = Identity.from_answer(values)
        identity.check()
        return identity

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
            if calibration := getattr(self._transport, "calibration", b""):
                self._parser.told_calibration(calibration)
            mark: Gap | None = getattr(self._transport, "mark", None)
            if mark is not None:
                yield mark
            for event in self._parser.feed(data, getattr(self._transport, "host_ns", 0)):
                if not isinstance(event, Answer | Again):
                    yield event

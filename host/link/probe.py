"""The client: one class for a real port, an emulated probe and a recording.

    with Probe.open("auto") as probe:
        print(probe.identity.serial)
        for event in probe.stream(strokes=3):
            match event:
                case Estimate():
                    print(event.as_dict())

A thread reads the port, counts, records and acknowledges; the program takes events from a bounded queue at
its own pace (frames that it is too slow for are dropped, oldest first, and counted; the recording has them
all). After an unplug the thread waits for the probe, resumes the stream and hands on a `Gap`.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Protocol, Self

from firmware_py import messages, status, wire
from host.errors import CommandRefused, CommandTimeout, LinkGone, NotAProbe, NotLive, PalpateError, PortError
from host.link.clock import ClockState, ClockSync
from host.link.event_queue import EventQueue
from host.link.events import Answer, Boot, Event, Gap
from host.link.identity import Identity
from host.link.parser import HAVE, Again, LinkCounts, LiveParser
from host.link.transport import Transport

ANSWER_TIMEOUT_S = 0.4
RETRIES = 12
POLL_S = 0.05
RECONNECT_EVERY_S = 0.25


class Recorder(Protocol):
    """What a client tells about the wire; `host.record.writer.RecordingWriter` is one."""

    def received(self, raw: bytes, event: Event, host_ns: int) -> None: ...

    def sent(self, raw: bytes, host_ns: int) -> None: ...

    def mark(self, event: Event) -> None: ...


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
        self.parser = LiveParser()
        self.recorder = recorder
        self._transport = transport
        self._reopen = reopen
        self._events = EventQueue()
        self._pending: dict[int, Answer | None] = {}
        self._answered = threading.Condition()
        self._unawaited: dict[int, None] = {}
        self._next_id = random.randrange(1 << 16)
        self._writing = threading.Lock()
        self._stopping = threading.Event()
        self._up = threading.Event()
        self._failure: PalpateError | None = None
        self._sync = ClockSync()
        self._stream: tuple[int, int, int] | None = None
        self._thread: threading.Thread | None = None
        self._up.set()
        if transport.live:
            self._thread = threading.Thread(target=self._read_forever, name="palpate-link", daemon=True)
            self._thread.start()
        try:
            self.identity = self._handshake()
            self.identity.check()
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
        from host.link.devices import resolve
        from host.link.transport import open_transport

        if port.endswith(".mcap"):
            from host.record.playback import PlaybackTransport

            return cls(PlaybackTransport(port))
        path, serial = resolve(port, baud)

        def reopen() -> Transport:
            return open_transport(resolve(serial, baud)[0] if serial else path, baud)

        return cls(open_transport(path, baud), recorder, reopen)

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
        return self._transport.live

    @property
    def connected(self) -> bool:
        """False while the probe is unplugged."""
        return self._up.is_set() and self._failure is None

    @property
    def counts(self) -> LinkCounts:
        """What this end counted (`probe.statistics()` has the other end's)."""
        counts = self.parser.counts
        counts.queue_dropped = self._events.dropped
        return counts

    @property
    def clock(self) -> ClockState | None:
        """Offset and drift of the probe's clock; None before `sync_clock`."""
        return self._sync.state

    def close(self) -> None:
        """Stop reading and close the port; harmless when repeated. What was recorded stays the recorder's."""
        self._stopping.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
        self.parser.settle()
        self._transport.close()

    # Commands

    def command(
        self,
        name: str,
        *values: int,
        tail: bytes = b"",
        timeout_s: float = ANSWER_TIMEOUT_S,
        retries: int = RETRIES,
    ) -> tuple[Any, ...]:
        """Give a command and wait for its answer; the same bytes are sent again until it comes.

        Parameters
        ----------
        name : str
            Of `firmware_py.messages.COMMANDS`.
        values, tail
            Its fields, in order.
        timeout_s : float
            How long to wait for an answer before sending again, s.
        retries : int
            How often to send again.

        Returns
        -------
        tuple
            The answer's fields.

        Raises
        ------
        CommandTimeout
            No answer after all retries.
        CommandRefused
            The probe's status was negative.
        LinkGone
            The port vanished and does not come back.
        NotLive
            The source is a recording.
        """
        return self._ask(name, values, tail, timeout_s, retries).values

    def _ask(self, name: str, values: tuple[int, ...], tail: bytes, timeout_s: float, retries: int) -> Answer:
        if not self.live:
            raise NotLive(f"{self.name} is a recording: it cannot be given the command {name}")
        number = self._take_id()
        raw = pack_command(name, number, values, tail)
        self.counts.commands += 1
        with self._answered:
            self._pending[number] = None
        try:
            answer = self._converse(name, number, raw, timeout_s, retries)
        finally:
            with self._answered:
                self._pending.pop(number, None)
        if answer.kind != messages.TYPE[name] | messages.ANSWER:
            raise CommandRefused(name, answer.status, status.TEXT[status.BAD_TYPE])
        if answer.status < 0:
            reason = status.TEXT.get(answer.status, "for a reason this program does not know")
            raise CommandRefused(name, answer.status, reason)
        return answer

    def _converse(self, name: str, number: int, raw: bytes, timeout_s: float, retries: int) -> Answer:
        for attempt in range(retries + 1):
            self._wait_until_up()
            if attempt:
                self.counts.retries += 1
            self._write(raw)
            deadline = time.monotonic() + timeout_s
            with self._answered:
                while True:
                    answer = self._pending.get(number)
                    if answer is not None:
                        return answer
                    left = deadline - time.monotonic()
                    if left <= 0 or self._failure is not None:
                        break
                    self._answered.wait(left)
        if self._failure is not None:
            raise self._failure
        raise CommandTimeout(
            f"the probe at {self.name} did not answer {name} in {timeout_s * (retries + 1):.1f} s; "
            "reset it or plug it in again"
        )

    def _take_id(self) -> int:
        with self._answered:
            self._next_id = (self._next_id + 1) % (1 << 16)
            return self._next_id

    def _write(self, raw: bytes) -> None:
        try:
            with self._writing:
                self._transport.write(raw)
        except LinkGone:
            if self._reopen is None:
                raise
            return  # the reader notices, too, and reconnects; the retry goes out then
        if self.recorder is not None:
            self.recorder.sent(raw, time.time_ns())

    def _wait_until_up(self) -> None:
        while not self._up.wait(POLL_S):
            if self._stopping.is_set():
                raise LinkGone(f"{self.name} was closed")
        if self._failure is not None:
            raise self._failure

    def sync_clock(self, exchanges: int = 8) -> ClockState:
        """Compare the clocks a few times; may be repeated for a better drift.

        Returns
        -------
        ClockState
            Offset, drift and their doubt.
        """
        for _ in range(exchanges):
            asked_ns = time.time_ns()
            answer = self._ask("time_sync", (), b"", ANSWER_TIMEOUT_S, RETRIES)
            taken, answered = answer.values
            self._sync.add(asked_ns / 1000, taken, answered, answer.host_ns / 1000)
        state = self._sync.state
        assert state is not None
        return state

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
        self.identity = self._identify()
        return self.identity

    def read_back(self, what: int) -> bytes:
        """The stored calibration (0) or the live model image (1), bit for bit; b"" where there is none."""
        found = b""
        while True:
            try:
                _, offset, size, piece = self.command("read_back", what, len(found))
            except CommandRefused as refusal:
                if refusal.status in (status.NO_MODEL, status.NOT_SUPPORTED, status.BAD_STATE):
                    return b""
                raise
            if offset == len(found):
                found += piece
            if len(found) >= size or not piece:
                return found

    # Events

    def start_stream(
        self, strokes: int = 0, every: int = 1, frames: bool = True, compressed: bool = False
    ) -> None:
        """Ask for frames and stroke results; after an unplug the stream is asked for again by itself.

        Parameters
        ----------
        strokes : int
            The probe stops by itself after so many; 0 never.
        every : int
            Send each n-th frame.
        frames : bool
            False: only states, maps and estimates.
        compressed : bool
            Allow losslessly compressed frames.
        """
        content = messages.CONTENT_STROKES
        content |= messages.CONTENT_FRAMES if frames else 0
        content |= messages.CONTENT_COMPRESSED if compressed else 0
        self._stream = (content, every, strokes)
        self.command("stream_start", *self._stream)

    def stop_stream(self) -> None:
        """Stop the stream; what is still on its way can be read from `events`."""
        self._stream = None
        self.command("stream_stop")

    def events(self, timeout_s: float | None = None) -> Iterator[Event]:
        """Events as they come, until `timeout_s` passes without one, the recording ends or the link fails.

        Raises
        ------
        LinkGone
            The port vanished and cannot be opened again.
        """
        if not self.live:
            yield from self._play()
            return
        while True:
            event = self._events.get(timeout_s)
            if event is None:
                if self._failure is not None:
                    raise self._failure
                return
            yield event

    def stream(self, strokes: int = 0, every: int = 1, timeout_s: float | None = None) -> Iterator[Event]:
        """Start the stream, hand on its events, and stop it when `strokes` estimates have come (0: never).

        A recording plays from its beginning, as it came.
        """
        from host.link.events import Estimate

        if not self.live:
            yield from self.events()
            return
        self.start_stream(0, every)
        done = 0
        try:
            for event in self.events(timeout_s):
                yield event
                if isinstance(event, Estimate):
                    done += 1
                    if done == strokes:
                        break
        finally:
            if self.connected and not self._stopping.is_set():
                self.stop_stream()

    # The thread that reads

    def _read_forever(self) -> None:
        try:
            while not self._stopping.is_set():
                try:
                    self._pump(POLL_S)
                except LinkGone as gone:
                    if self._reopen is None or self._stopping.is_set():
                        raise
                    self._reconnect(gone)
        except PalpateError as error:
            self._fail(error)
        except Exception as error:
            self._fail(LinkGone(f"reading {self.name} failed: {error!r}"))

    def _fail(self, error: PalpateError) -> None:
        if isinstance(error, LinkGone) and self._stopping.is_set():
            return
        self._failure = error
        self._up.set()
        self._events.close()
        with self._answered:
            self._answered.notify_all()

    def _pump(self, timeout_s: float) -> None:
        data = self._transport.read(timeout_s)
        if not data:
            self.parser.settle()
            return
        host_ns = time.time_ns()
        for event in self.parser.feed(data, host_ns):
            if self.recorder is not None:
                self.recorder.received(self.parser.raw, event, host_ns)
            self._dispatch(event)

    def _dispatch(self, event: Event) -> None:
        if isinstance(event, Answer):
            self._take_answer(event)
            return
        if type(event) is Again:
            self._acknowledge(event.event)
            return
        if type(event) in HAVE:
            self._acknowledge(event)
        if isinstance(event, Boot):
            self._sync.restart()
        self._events.put(event)

    def _take_answer(self, answer: Answer) -> None:
        with self._answered:
            if self._pending.get(answer.message_id, answer) is None:
                self._pending[answer.message_id] = answer
                self._answered.notify_all()
            elif answer.message_id in self._unawaited:
                del self._unawaited[answer.message_id]
            else:
                self.parser.counts.late_answers += 1

    def _acknowledge(self, event: Any) -> None:
        number = self._take_id()
        self._unawaited[number] = None
        if len(self._unawaited) > 256:
            del self._unawaited[next(iter(self._unawaited))]
        self._write(pack_command("stroke_ack", number, (event.stroke, HAVE[type(event)])))

    def _play(self) -> Iterator[Event]:
        """A recording has no thread: it is read as fast as its reader goes."""
        while True:
            try:
                data = self._transport.read(0.0)
            except LinkGone:
                self.parser.settle()
                return
            host_ns = getattr(self._transport, "host_ns", 0)
            for event in self.parser.feed(data, host_ns):
                if not isinstance(event, Answer | Again):
                    yield event

    # Handshake and reconnection

    def _handshake(self) -> Identity:
        if not self.live:
            identity = getattr(self._transport, "identity", None)
            if identity is None:
                raise NotAProbe(f"{self.name} holds no handshake; it is not a Palpate recording")
            return Identity.from_answer(identity)
        try:
            return self._identify()
        except CommandTimeout as error:
            raise NotAProbe(
                f"{self.name} does not answer as a Palpate probe; check the port (`palpate devices`) "
                "and that the firmware runs"
            ) from error

    def _identify(self) -> Identity:
        nonce = random.randrange(1 << 30)
        values = self.command("identify", nonce, timeout_s=0.5, retries=5)
        if values[0] != nonce:
            values = self.command("identify", nonce, timeout_s=0.5, retries=5)
        return Identity.from_answer(values)

    def _reconnect(self, gone: LinkGone) -> None:
        """Wait for the probe, shake hands, ask for the stream again; the gap is marked at both its ends."""
        assert self._reopen is not None
        began = time.monotonic()
        self._up.clear()
        self._transport.close()
        self._tell(Gap(time.time_ns(), 0.0, str(gone), ended=False))
        while not self._stopping.is_set():
            try:
                self._transport = self._reopen()
                identity = self._ask_inline("identify", (random.randrange(1 << 30),))
                if identity is None:
                    raise LinkGone(f"{self.name} does not answer")
                self._welcome_back(Identity.from_answer(identity), began, str(gone))
                return
            except (PortError, LinkGone):
                self._transport.close()
                self._stopping.wait(RECONNECT_EVERY_S)

    def _welcome_back(self, identity: Identity, began: float, reason: str) -> None:
        identity.check()
        restarted = identity.boots != self.identity.boots or identity.serial != self.identity.serial
        if restarted:
            self._sync.restart()
        self.identity = identity
        if self._stream is not None and self._ask_inline("stream_start", self._stream) is None:
            raise LinkGone(f"{self.name} does not answer")
        self.counts.reconnects += 1
        self._tell(Gap(time.time_ns(), time.monotonic() - began, reason, restarted=restarted))
        self._up.set()

    def _ask_inline(self, name: str, values: tuple[int, ...]) -> tuple[Any, ...] | None:
        """A command given by the reading thread itself, which reads its own answer."""
        number = self._take_id()
        raw = pack_command(name, number, values)
        with self._answered:
            self._pending[number] = None
        try:
            for _ in range(8):
                self._transport.write(raw)
                if self.recorder is not None:
                    self.recorder.sent(raw, time.time_ns())
                deadline = time.monotonic() + ANSWER_TIMEOUT_S
                while (left := deadline - time.monotonic()) > 0 and not self._stopping.is_set():
                    self._pump(min(left, POLL_S))
                    answer = self._pending.get(number)
                    if answer is not None:
                        return answer.values if answer.status >= 0 else None
            return None
        finally:
            with self._answered:
                self._pending.pop(number, None)

    def _tell(self, event: Event) -> None:
        if self.recorder is not None:
            self.recorder.mark(event)
        self._events.put(event)


def pack_command(name: str, number: int, values: tuple[int, ...] = (), tail: bytes = b"") -> bytes:
    """A command's bytes on the wire: a zero, the packet, its closing zero; at most 64 bytes.

    Parameters
    ----------
    name : str
        Of `firmware_py.messages.COMMANDS`.
    number : int
        Its id, 16 bit.
    values, tail
        Its fields.
    """
    body = bytearray(messages.COMMAND_BODY)
    length = messages.pack(body, messages.TYPE[name], number, 0, values, tail)
    body += bytes(4)
    target = bytearray(1 + wire.wire_size(length))
    end = wire.seal(body, length, target, 1)
    return bytes(target[:end])


def setting_key(name: str) -> int:
    """The key of a setting by its name; `UsageError` names the known ones."""
    from host.errors import UsageError

    keys = {row[1]: row[0] for row in messages.SETTINGS}
    if name not in keys:
        raise UsageError(f"there is no setting {name!r}; known are {', '.join(keys)}")
    return int(keys[name])

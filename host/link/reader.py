"""The thread behind a line: it reads, counts, records and acknowledges.

Everything that comes is recorded and counted before the program sees it; the program's queue is bounded.
"""

from __future__ import annotations

import threading
import time

from host.errors import LinkGone, PalpateError
from host.link.commands import PendingCommands, pack_command
from host.link.event_queue import EventQueue
from host.link.events import Answer, Event
from host.link.parser import LiveParser
from host.link.recorder import Recorder
from host.link.results import HAVE, Again
from host.link.transport import Transport

POLL_S = 0.05


class LineReader:
    """A transport that is read by a thread of its own, from the start until `close`.

    Parameters
    ----------
    transport : Transport
        Open and live; the reader closes it.
    recorder : Recorder, optional
        Is told every byte, both ways.
    """

    def __init__(self, transport: Transport, recorder: Recorder | None = None) -> None:
        self.transport = transport
        self.recorder = recorder
        self.parser = LiveParser()
        self.events = EventQueue()
        self.failure: PalpateError | None = None
        self._pending = PendingCommands()
        self._writing = threading.Lock()
        self._stopping = threading.Event()
        self._up = threading.Event()
        self._up.set()
        self._thread = threading.Thread(target=self._run, name="palpate-line", daemon=True)
        self._thread.start()

    @property
    def connected(self) -> bool:
        """False while the probe is unplugged, and after the line has failed or was closed."""
        return self._up.is_set() and self.failure is None and not self._stopping.is_set()

    def close(self) -> None:
        """Stop reading and close the transport; harmless when repeated."""
        self._stopping.set()
        self._thread.join()
        self.parser.settle()
        tail = self.parser.take_tail()
        if tail and self.recorder is not None:
            self.recorder.received(tail, None, time.time_ns())
        self.transport.close()

    def _comes_back(self) -> bool:
        """Whether a link that broke is waited for."""
        return False

    def _wait_for_return(self, gone: LinkGone) -> None:
        """What to do about a link that broke; when this returns, it is whole again."""
        raise gone

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                try:
                    self._pump(POLL_S)
                except LinkGone as gone:
                    self._wait_for_return(gone)
        except PalpateError as error:
            self._fail(error)
        except Exception as error:
            self._fail(LinkGone(f"reading {self.transport.name} failed ({error!r}); plug the probe in again"))

    def _fail(self, error: PalpateError) -> None:
        self.failure = error
        self._up.set()
        self.events.close()
        self._pending.wake()

    def _pump(self, timeout_s: float) -> None:
        data = self.transport.read(timeout_s)
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
            if not self._pending.deliver(event):
                self.parser.counts.late_answers += 1
            return
        result = event.event if isinstance(event, Again) else event
        have = HAVE.get(type(result))
        if have is not None:
            number = self._pending.begin_unawaited()
            self._write(pack_command("stroke_ack", number, (getattr(result, "stroke"), have)))  # noqa: B009
        if result is event:
            self.events.put(event)

    def _write(self, raw: bytes) -> None:
        self._note_sent(raw)  # first: the answer may be read before the write returns
        try:
            with self._writing:
                self.transport.write(raw)
        except LinkGone:
            if not self._comes_back():
                raise
            # the thread notices, too, and reconnects; the retry goes out then

    def _note_sent(self, raw: bytes) -> None:
        self.parser.commanded(raw)
        if self.recorder is not None:
            self.recorder.sent(raw, time.time_ns())

    def _tell(self, event: Event) -> None:
        if self.recorder is not None:
            self.recorder.mark(event)
        self.events.put(event)

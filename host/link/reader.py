"""The thread behind a line: it reads, counts, records and acknowledges.

Everything is recorded and counted before the program sees it; the program's queue is bounded.
"""

from __future__ import annotations

import threading
import time
from collections import deque

from palpate.errors import LinkGone, PalpateError
from palpate.link.commands import PendingCommands, pack_command
from palpate.link.emulated import times_slower
from palpate.link.event_queue import EventQueue
from palpate.link.host_clock import HostClock
from palpate.link.recorder import Recorder
from palpate.link.transport import Transport
from palpate.wire.delivery import HAVE, Again, Earlier
from palpate.wire.events import Answer, Estimate, Event, Features, TactileMap
from palpate.wire.parser import LineNoise, LiveParser

POLL_S = 0.05
EARLIER_KEPT = 256


class LineReader:
    """A transport that is read by a thread of its own, from the start until `close`.

    Parameters
    ----------
    transport : Transport
        Open and live; the reader closes it.
    recorder : Recorder, optional
        Receives every byte, both ways.
    """

    def __init__(self, transport: Transport, recorder: Recorder | None = None) -> None:
        self.transport = transport
        self.recorder = recorder
        self.times_slower = times_slower(transport.name)
        """Seconds of this computer that one of the probe's takes."""
        self._heard = time.monotonic()
        self.clock = HostClock()
        self.parser = LiveParser(own_only=True)
        self.events = EventQueue()
        self.earlier: deque[Estimate | Features | TactileMap] = deque(maxlen=EARLIER_KEPT)
        """Results of other clients' streams, as they came; they are not acknowledged."""
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
        self._note_tail()
        self.transport.close()

    def _look_after(self) -> None:
        """What is to be done from time to time, between two reads."""

    def _comes_back(self) -> bool:
        """Whether to wait for a broken link to come back."""
        return False

    def _wait_for_return(self, gone: LinkGone) -> None:
        """Handle a broken link; when this returns, the link is up again."""
        raise gone

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                try:
                    self._pump(POLL_S)
                    self._look_after()
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
            if time.monotonic() - self._heard >= POLL_S * self.times_slower or self.times_slower == 1:
                self.parser.settle()
                self._note_tail()
            return
        self._heard = time.monotonic()
        host_ns = self.clock.now_ns()
        for event in self.parser.feed(data, host_ns):
            if self.recorder is not None:
                self.recorder.received(self.parser.raw, event, host_ns)
            self._dispatch(event)

    def _note_tail(self) -> None:
        """Record the bytes that no event came of: noise, too, belongs to what the wire carried."""
        if self.recorder is not None and (tail := self.parser.take_tail()):
            self.recorder.received(tail, None, self.clock.now_ns())

    def _dispatch(self, event: Event) -> None:
        if isinstance(event, LineNoise):
            return
        if isinstance(event, Answer):
            if not self._pending.deliver(event):
                self.parser.counts.late_answers += 1
            return
        if isinstance(event, Earlier):
            self.earlier.append(event.event)
            return
        result = event.event if isinstance(event, Again) else event
        if isinstance(result, Estimate | Features | TactileMap):
            self.acknowledge(result)
        if result is event:
            self.events.put(event)

    def acknowledge(self, result: Estimate | Features | TactileMap) -> None:
        """Tell the probe that this has arrived; its answer is not waited for."""
        number = self._pending.begin_unawaited()
        self._write(pack_command("stroke_ack", number, (result.stream, result.stroke, HAVE[type(result)])))

    def _write(self, raw: bytes) -> None:
        self._note_sent(raw)  # first: the answer may be read before the write returns
        try:
            with self._writing:
                self.transport.write(raw)
        except LinkGone:
            if not self._comes_back():
                raise
            # the thread notices as well and reconnects; the retry goes out then

    def _note_sent(self, raw: bytes) -> None:
        self.parser.commanded(raw)
        if self.recorder is not None:
            self.recorder.sent(raw, self.clock.now_ns())

    def _tell(self, event: Event) -> None:
        if self.recorder is not None:
            self.recorder.mark(event)
        self.events.put(event)

"""The live line: one thread that reads, counts, records, acknowledges, and waits for an unplugged probe.

Everything that comes is recorded and counted before the program sees it; the program's queue is bounded.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable

from firmware_py import calib, messages
from host.errors import CommandTimeout, LinkGone, PalpateError, PortError
from host.link.commands import PendingCommands, check_answer, pack_command
from host.link.event_queue import EventQueue
from host.link.events import Answer, Event, Gap
from host.link.identity import Identity
from host.link.parser import HAVE, Again, LiveParser
from host.link.patience import FIRST_WAIT_S, Patience
from host.link.recorder import Recorder
from host.link.transport import Transport

GIVE_UP_S = 6.0
"""How long a command is repeated before the probe counts as silent."""
POLL_S = 0.05
REOPEN_EVERY_S = 0.25
INLINE_TRIES = 3


class Line:
    """A transport with its reading thread.

    Parameters
    ----------
    transport : Transport
        Open and live; the line closes it.
    recorder : Recorder, optional
        Is told every byte, both ways.
    reopen : callable, optional
        Opens the link again after an unplug; without it a broken link ends the line.
    """

    def __init__(
        self,
        transport: Transport,
        recorder: Recorder | None = None,
        reopen: Callable[[], Transport] | None = None,
    ) -> None:
        self.transport = transport
        self.recorder = recorder
        self.parser = LiveParser()
        self.events = EventQueue()
        self.identity: Identity | None = None
        self.stream: tuple[int, int, int] | None = None
        """The stream to ask for again after an unplug: content, every, strokes."""
        self.failure: PalpateError | None = None
        self._patience = Patience()
        self.asked_ns = 0
        """When the last question of `ask_afresh` left."""
        self._reopen = reopen
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

    def ask(
        self,
        name: str,
        values: tuple[int, ...] = (),
        tail: bytes = b"",
        timeout_s: float = GIVE_UP_S,
        once: bool = False,
    ) -> Answer:
        """Give a command and wait for its answer; see `Probe.command`. `once`: never send it again."""
        number = self._pending.begin()
        raw = pack_command(name, number, values, tail)
        counts = self.parser.counts
        counts.commands += 1
        patience_s = timeout_s if once else min(self._patience.wait_s, timeout_s)
        waited_s = 0.0  # on a line that is up: an unplugged probe's time does not count
        tries = 0
        try:
            while waited_s < timeout_s:
                self._wait_until_up()
                counts.retries += 1 if tries else 0
                tries += 1
                began = time.monotonic()
                self._write(raw)
                answer = self._pending.wait(number, patience_s)
                if answer is not None:
                    self._patience.learn(time.monotonic() - began)
                    return check_answer(name, answer)
                waited_s += patience_s
                patience_s = self._patience.longer(patience_s)
        finally:
            self._pending.end(number)
        if self.failure is not None:
            raise self.failure
        raise CommandTimeout(
            f"the probe at {self.transport.name} did not answer {name} within {timeout_s:g} s "
            f"(sent {tries} times); reset it or plug it in again"
        )

    def ask_afresh(self, name: str, tries: int = 20) -> Answer:
        """Ask under a new id each time: for questions whose old answer is worth nothing (the time)."""
        for _ in range(tries - 1):
            try:
                self.asked_ns = time.time_ns()
                return self.ask(name, timeout_s=self._patience.wait_s, once=True)
            except CommandTimeout:
                self.parser.counts.retries += 1
        self.asked_ns = time.time_ns()
        return self.ask(name, once=True)

    def _wait_until_up(self) -> None:
        while not self._up.wait(POLL_S):
            if self._stopping.is_set():
                raise LinkGone(f"{self.transport.name} was closed")
        if self.failure is not None:
            raise self.failure

    def _write(self, raw: bytes) -> None:
        self._note_sent(raw)  # first: the answer may be read before the write returns
        try:
            with self._writing:
                self.transport.write(raw)
        except LinkGone:
            if self._reopen is None:
                raise
            # the reader notices, too, and reconnects; the retry goes out then

    def _note_sent(self, raw: bytes) -> None:
        self.parser.commanded(raw)
        if self.recorder is not None:
            self.recorder.sent(raw, time.time_ns())

    # The thread

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                try:
                    self._pump(POLL_S)
                except LinkGone as gone:
                    if self._reopen is None or self.identity is None:
                        raise
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

    # After an unplug

    def _wait_for_return(self, gone: LinkGone) -> None:
        """Open the port until the probe answers, ask for the stream again; the gap is marked at both ends."""
        assert self._reopen is not None
        began = time.monotonic()
        self._up.clear()
        self.transport.close()
        self._tell(Gap(time.time_ns(), 0.0, str(gone), ended=False))
        while not self._stopping.is_set():
            try:
                self.transport = self._reopen()
                if self._welcome_back(began, str(gone)):
                    return
            except (PortError, LinkGone):
                pass
            self.transport.close()
            self._stopping.wait(REOPEN_EVERY_S)

    def _welcome_back(self, began: float, reason: str) -> bool:
        answer = self._ask_inline("identify", (random.randrange(1 << 30),))
        if answer is None:
            return False
        before, now = self.identity, Identity.from_answer(answer.values)
        now.check()
        if before is not None and now.serial != before.serial:
            return False  # another probe, or another program's terminal under the old name: wait for ours
        if self.stream is not None:
            self._read_calibration_inline()
            if self._ask_inline("stream_start", self.stream) is None:
                return False
        restarted = before is None or now.boots != before.boots
        self.identity = now
        self.parser.counts.reconnects += 1
        self._tell(Gap(time.time_ns(), time.monotonic() - began, reason, restarted=restarted))
        self._up.set()
        return True

    def _read_calibration_inline(self) -> None:
        """Another host may have calibrated the probe meanwhile; the parser learns from the answers.

        Where an answer does not come the stream goes on with the calibration that is known.
        """
        at = 0
        while self.parser.scale.calibrated and at < calib.BLOB_BYTES:
            answer = self._ask_inline("read_back", (messages.READ_CALIBRATION, at))
            if answer is None or not answer.values[-1]:
                return
            at += len(answer.values[-1])

    def _ask_inline(self, name: str, values: tuple[int, ...]) -> Answer | None:
        """A command given by the reading thread itself, which must read its own answer."""
        number = self._pending.begin()
        raw = pack_command(name, number, values)
        try:
            for _ in range(INLINE_TRIES):
                self._note_sent(raw)
                self.transport.write(raw)
                deadline = time.monotonic() + FIRST_WAIT_S
                while (left := deadline - time.monotonic()) > 0 and not self._stopping.is_set():
                    self._pump(min(left, POLL_S))
                    answer = self._pending.get(number)
                    if answer is not None:
                        return answer if answer.kind & messages.ANSWER and answer.status >= 0 else None
            return None
        finally:
            self._pending.end(number)

    def _tell(self, event: Event) -> None:
        if self.recorder is not None:
            self.recorder.mark(event)
        self.events.put(event)

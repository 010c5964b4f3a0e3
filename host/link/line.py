"""The live line: commands and their answers, and waiting for a probe that was unplugged.

How long a probe is waited for is reckoned in its own seconds: an emulated board takes many of the computer's
for one (`palpate.link.emulated.times_slower`).
"""

from __future__ import annotations

import logging
import random
import time
from collections.abc import Callable

from firmware_py import calib, messages, status
from palpate.errors import CommandTimeout, LinkGone, NotAProbe, PortError
from palpate.link.commands import check_answer, pack_command
from palpate.link.emulated import times_slower
from palpate.link.patience import FIRST_WAIT_S, Patience
from palpate.link.reader import POLL_S, LineReader
from palpate.link.recorder import Recorder
from palpate.link.stream_wish import RENEW_S, StreamWish
from palpate.link.transport import Transport
from palpate.wire.events import Answer, Estimate, Event, Gap, StreamEnd
from palpate.wire.identity import Identity

_log = logging.getLogger(__name__)

AWAY_S = 60.0
"""How long a command waits for an unplugged probe to come back (a stream waits forever)."""
GIVE_UP_S = 6.0
"""How long a command is repeated before the probe counts as silent."""
REOPEN_EVERY_S = 0.25
ELSEWHERE_S = 5.0
"""A probe that has been gone for so long may have been replaced, where any will do."""
INLINE_TRIES = 3


class Line(LineReader):
    """A transport with its reading thread, for sending commands to the probe.

    Parameters
    ----------
    transport : Transport
        Open and live; the line closes it.
    recorder : Recorder, optional
        Is told every byte, both ways.
    reopen : callable, optional
        Opens the link again after an unplug; without it a broken link ends the line.
    elsewhere : callable, optional
        Opens a link to whatever probe is there: a stream, and nothing else, goes on with another one.
    """

    def __init__(
        self,
        transport: Transport,
        recorder: Recorder | None = None,
        reopen: Callable[[], Transport] | None = None,
        elsewhere: Callable[[], Transport] | None = None,
    ) -> None:
        self.identity: Identity | None = None
        self.stream: StreamWish | None = None
        """The stream to request again after an unplug."""
        self._ended = self._renewal = -1
        self.asked_ns = 0
        """When the last request of `ask_afresh` left."""
        self._patience = Patience()
        self._reopen, self._elsewhere = reopen, elsewhere
        super().__init__(transport, recorder)

    def ask(
        self,
        name: str,
        values: tuple[int | bytes, ...] = (),
        tail: bytes = b"",
        timeout_s: float = GIVE_UP_S,
        once: bool = False,
    ) -> Answer:
        """Send a command and wait for its answer; see `Probe.command`. `once`: never send it again.

        All waiting is in the probe's seconds.
        """
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
                if tries:
                    counts.retries += 1
                    _log.info("%s: no answer to %s yet, sent again", self.transport.name, name)
                tries += 1
                began = time.monotonic()
                self._write(raw)
                answer = self._pending.wait(number, patience_s * self.times_slower)
                if answer is not None:
                    self._patience.learn((time.monotonic() - began) / self.times_slower)
                    return check_answer(name, answer)
                waited_s += patience_s
                patience_s = self._patience.longer(patience_s)
        finally:
            self._pending.end(number)
        if self.failure is not None:
            raise self.failure
        tried_s = timeout_s * self.times_slower
        raise CommandTimeout(
            f"the probe at {self.transport.name} did not answer {name} within {tried_s:.3g} s "
            f"(sent {tries} times); reset it or plug it in again"
        )

    def ask_afresh(self, name: str, tries: int = 20) -> Answer:
        """Ask under a new id each time: for requests whose answers go stale (the time)."""
        for _ in range(tries - 1):
            try:
                self.asked_ns = self.clock.now_ns()
                return self.ask(name, timeout_s=self._patience.wait_s, once=True)
            except CommandTimeout:
                self.parser.counts.retries += 1
        self.asked_ns = self.clock.now_ns()
        return self.ask(name, once=True)

    def _wait_until_up(self) -> None:
        began = time.monotonic()
        while not self._up.wait(POLL_S):
            if self._stopping.is_set():
                raise LinkGone(f"{self.transport.name} was closed")
            if time.monotonic() - began > AWAY_S:
                raise LinkGone(f"{self.transport.name} is gone and has not come back for {AWAY_S:g} s")
        if self.failure is not None:
            raise self.failure

    # After an unplug

    def _comes_back(self) -> bool:
        return self._reopen is not None

    def _wait_for_return(self, gone: LinkGone) -> None:
        """Open the port until the probe answers, ask for the stream again; the gap is marked at both ends."""
        if self._reopen is None or self.identity is None:
            raise gone
        began = time.monotonic()
        self._up.clear()
        self.transport.close()
        self._tell(Gap(self.clock.now_ns(), 0.0, str(gone), ended=False))
        _log.warning("%s is gone: %s", self.transport.name, gone)
        while not self._stopping.is_set():
            elsewhere = self._elsewhere if self._may_be_replaced(began) else None
            try:
                self.transport = (elsewhere or self._reopen)()
                self.times_slower = times_slower(self.transport.name)
                if self._welcome_back(began, str(gone), any_probe=elsewhere is not None):
                    return
            except (PortError, LinkGone, NotAProbe):
                pass
            self.transport.close()
            self._stopping.wait(REOPEN_EVERY_S)

    def _may_be_replaced(self, began: float) -> bool:
        """Only a stream goes on with another probe: a model is never flashed to two halves of two."""
        return self.stream is not None and time.monotonic() - began > ELSEWHERE_S

    def _welcome_back(self, began: float, reason: str, any_probe: bool) -> bool:
        answer = self._ask_inline("identify", (random.randrange(1 << 30),))
        if answer is None:
            return False
        before, now = self.identity, Identity.from_answer(answer.values)
        now.check()
        another = before is not None and now.serial != before.serial
        if another and not any_probe:
            return False  # another probe, or another program's terminal under the old name: wait for ours
        if (wanted := self.stream) is not None:
            self._read_calibration_inline()
            wanted.number = 0 if another else wanted.number  # its streams are none of ours
            if not self._goes_on(wanted):
                return False
        unwanted = self.stream is None and self.parser.streaming
        if unwanted and self._ask_inline("stream_stop", ()) is None:
            return False
        restarted = before is None or another or now.boots != before.boots
        self.identity = now
        self.parser.counts.reconnects += 1
        self._tell(Gap(self.clock.now_ns(), time.monotonic() - began, reason, restarted=restarted))
        _log.warning("%s is back after %.1f s", self.transport.name, time.monotonic() - began)
        self._up.set()
        return True

    def _goes_on(self, wanted: StreamWish) -> bool:
        """Renew the stream; where the probe has ended it, begin another and fetch what is left of it."""
        before = wanted.number
        if before and self._ask_inline("stream_renew", (before,)) is not None:
            wanted.renewed = time.monotonic()
            self._ask_inline("results", (before,))
            return True
        answer = self._ask_inline("stream_start", wanted.words)
        if answer is None:
            return False
        wanted.number, wanted.renewed = answer.values[0], time.monotonic()
        if before:
            self._ask_inline("results", (before,))
        return True

    def _look_after(self) -> None:
        """Keep the wanted stream's lease; where it has run out (this program was stopped), begin anew."""
        wanted = self.stream
        if wanted is None or not wanted.number or not self._up.is_set():
            return
        if self._ended == wanted.number and not self._goes_on(wanted):
            return
        # what measured the times slower may have been busier than it is now: the lease must not run out
        if time.monotonic() - wanted.renewed > RENEW_S * max(1.0, self.times_slower / 3):
            wanted.renewed = time.monotonic()
            self._renewal = self._pending.begin_unawaited()
            self._write(pack_command("stream_renew", self._renewal, (wanted.number,)))

    def _dispatch(self, event: Event) -> None:
        wanted = self.stream
        if wanted is not None and isinstance(event, StreamEnd) and event.stream == wanted.number:
            if event.reason == "lease":
                self._ended = event.stream
            else:
                self.stream = None
        elif wanted is not None and isinstance(event, Answer) and event.message_id == self._renewal:
            if event.status == status.NOT_KNOWN:
                self._ended = wanted.number
        elif wanted is not None and isinstance(event, Estimate) and wanted.strokes > 1:
            wanted.strokes -= 1  # so many are still wanted, should it have to be begun anew
        super()._dispatch(event)

    def _read_calibration_inline(self) -> None:
        """Another host may have calibrated the probe meanwhile; the parser learns from the answers.

        Where no answer comes, the stream goes on with the known calibration.
        """
        at = 0
        while self.parser.scale.calibrated and at < calib.BLOB_BYTES:
            answer = self._ask_inline("read_back", (messages.READ_CALIBRATION, at))
            if answer is None or not answer.values[-1]:
                return
            at += len(answer.values[-1])

    def _ask_inline(self, name: str, values: tuple[int, ...]) -> Answer | None:
        """A command sent by the reading thread itself, which must read its own answer."""
        number = self._pending.begin()
        raw = pack_command(name, number, values)
        try:
            for _ in range(INLINE_TRIES):
                self._note_sent(raw)
                self.transport.write(raw)
                deadline = time.monotonic() + FIRST_WAIT_S * self.times_slower
                while (left := deadline - time.monotonic()) > 0 and not self._stopping.is_set():
                    self._pump(min(left, POLL_S))
                    answer = self._pending.get(number)
                    if answer is not None:
                        return answer if answer.kind & messages.ANSWER and answer.status >= 0 else None
            return None
        finally:
            self._pending.end(number)

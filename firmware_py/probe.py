"""The probe: sensors to frames to strokes to estimates, and commands in between.

`run(board)` never returns. One class and one file, long as it is: another module or object would take of the
board's heap what a stroke needs.
"""

from firmware_py import (
    acquire,
    commands,
    counters,
    handlers,
    memory,
    messages,
    outbox,
    results,
    settings,
    status,
    stream,
    stroke_state,
    wire,
)

_CHUNK = 64  # bytes taken from the link at a time
_IDLE_US = 50000  # longest wait between two looks at what is due
_BUSY_US = 1000  # the same while the link has not taken everything
_SCAN_US = 200  # between two looks at a scan under way
_KEPT_SHORT = 4  # of the outbox's places: for answers and results, however many events there are
_KEPT_LONG = 1
_MASK = counters.MASK


class Probe:
    """Everything on one board. `step()` does what is due and returns; `run` calls it for ever.

    Parameters
    board: see firmware_py/boards/__init__.py
    estimator: what turns a stroke into an estimate, keeps calibration and model (estimator.Estimator),
        or None
        for a probe that only streams
    """

    def __init__(self, board, estimator=None):
        self.board = board
        self.estimator = estimator
        self.counts = counters.fresh()
        self.settings = settings.Settings(board.settings_record)
        values = self.settings.values
        self.box = outbox.Outbox(self.counts)
        self.receiver = wire.Receiver(messages.COMMAND_BODY)
        self.acquire = acquire.Acquire(board, self.counts, values)
        self.strokes = stroke_state.StrokeState(values)
        if estimator:
            self.strokes.zero_counts = estimator.zero_counts()
        self.results = results.Results(self.counts, self.box, values, settings.RESEND_RESULTS)
        self.commands = commands.Commands(self.counts, self.box, handlers.table(self))
        self._input = bytearray(_CHUNK)
        self._input_at = 0
        self._input_end = 0
        self._event_seq = 0
        self.stream = stream.Stream(board.boots)
        self._stroke = 0  # the last that was begun
        self.next_stroke = 1  # the number of the next that is not broken off
        self._first_seq = 0
        self._overrun_before = 0
        self._measuring = False
        self.received_us = 0
        self._ms_rest_us = 0
        self._last_us = board.ticks_us()
        self._post(messages.TYPE["boot"], (board.boots, self._health()))

    def damage(self):
        """What was found damaged in the store, as bits (messages.DAMAGED_...)."""
        return self.settings.damage() | (self.estimator.damage() if self.estimator else 0)

    def _health(self):
        """OK, or the worst that was found in the store at the start (status.py)."""
        found = self.estimator.health() if self.estimator else status.OK
        if found in (status.OK, status.REPAIRED) and self.settings.state != status.OK:
            return self.settings.state
        return found

    # ---- the loop

    def step(self):
        """Do what is due: listen, acquire, send; return for how many microseconds nothing will be."""
        board = self.board
        now_us = board.ticks_us()
        self._uptime(now_us)
        self._listen()
        wait_us = _IDLE_US
        if self.stream.content or self._measuring:
            if self.stream.silent(now_us):
                self._give_up(now_us)
            wait_us = self._acquire(now_us)
        self.results.step(now_us)
        self.box.pump(board)
        if wait_us > _BUSY_US and not self.box.idle():
            return _BUSY_US
        return wait_us if wait_us < _IDLE_US else _IDLE_US

    def _uptime(self, now_us):
        self._ms_rest_us += counters.elapsed(now_us, self._last_us)
        self._last_us = now_us
        counters.add(self.counts, counters.UPTIME_MS, self._ms_rest_us // 1000)
        self._ms_rest_us %= 1000

    def _listen(self):
        """Take commands one by one while there is room for an answer and no frame is due; the rest waits."""
        data = self._input
        receiver = self.receiver
        while self.box.room():
            if self._input_at >= self._input_end:
                n = self.board.read(data)
                if n <= 0:
                    return
                counters.add(self.counts, counters.BYTES_RECEIVED, n)
                self._input_at = 0
                self._input_end = n
            self._input_at = receiver.feed(data, self._input_at, self._input_end)
            if receiver.length:
                self.received_us = self.board.ticks_us()
                self.stream.heard(self.received_us)
                self.commands.take(receiver.packet, receiver.length)
                if self.stream.content and self.acquire.wait_us(self.received_us) <= 0:
                    return  # a frame is due: the next command waits for it

    def _acquire(self, now_us):
        """Begin the frame that is due, take the one that is measured; how long nothing will be."""
        take = self.acquire
        if not take.under_way:
            wait_us = take.wait_us(now_us)
            if wait_us > 0:
                return wait_us
            take.begin(now_us)
        if not self.board.scanned():
            return _SCAN_US
        self._frame()
        return 0

    def _frame(self):
        """Read one frame, watch it, queue it. Allocates nothing unless something happens."""
        box = self.box
        counts = box.counts()
        body = box.frame()
        take = self.acquire
        seq = take.seq
        take.read(body, counts)
        time_us = take.time_us
        position_um = take.position_um
        # the sensors are free: a frame that is due is measured while this one is worked on
        now_us = self.board.ticks_us()
        if take.wait_us(now_us) <= 0 and not self._measuring:
            take.begin(now_us)
        if self._measuring:
            self._measure(counts)
            return
        stream = self.stream
        if stream.sends_frame():
            box.commit_frame(messages.FRAME_BODY)
        if stream.watches_strokes():
            events = self.strokes.update(counts, position_um, time_us)
            tells = stream.content & messages.CONTENT_STROKES
            if self.estimator and tells:
                state = self.strokes.state
                paused = events & 1 << messages.STATE_ENDED and state == stroke_state.CONTACT
                # the frame that ends a stroke by standing still counts as one of it
                if state == stroke_state.STROKE or paused:
                    if events & 1 << messages.STATE_STARTED:
                        self.estimator.begin()
                    self.estimator.add_frame(counts, position_um, take.displacement_um)
                elif state == stroke_state.CONTACT:
                    if events & 1 << messages.STATE_CONTACT:
                        self.estimator.begin_press()
                    # after a stroke that has ended by standing still the press is over: no frame is taken
                    self.estimator.add_press(counts, take.displacement_um)
            if events and tells:
                self._tell(events, seq)
            if events & 1 << messages.STATE_ENDED:
                self._count_down()

    def begin_measuring(self):
        """Acquire frames for `estimator.measure` (a calibration, a reference press).

        False while a stream runs or it is at it.
        """
        if self.stream.content or self._measuring:
            return False
        self._measuring = True
        self.stream.lease_ms = messages.LEASE_MS
        self.board.begin()
        self.acquire.start(self.board.ticks_us())
        return True

    def measuring(self):
        """Whether a calibration or a reference press is under way."""
        return self._measuring

    def _measure(self, counts):
        take = self.acquire
        answer = self.estimator.measure(
            counts, self.strokes.in_contact(counts), take.position_um, take.displacement_um
        )
        if answer:
            self._end_measuring(answer)

    def _end_measuring(self, answer):
        self._measuring = False
        self.board.end()
        self.strokes.zero_counts = self.estimator.zero_counts()
        self.commands.finish(answer)

    def _give_up(self, now_us):
        """Nobody has said a word for the whole lease: there is no host any more."""
        counters.add(self.counts, counters.LEASES_EXPIRED, 1)
        if self._measuring:
            self._end_measuring((status.BAD_STATE, (), b""))
        else:
            self._end_stream(messages.END_LEASE)

    # ---- strokes

    def _tell(self, events, seq):
        state = 0
        while events >> state:
            if events >> state & 1:
                self._tell_one(state, seq)
            state += 1

    def _tell_one(self, state, seq):
        strokes = self.strokes
        if state == messages.STATE_STARTED:
            self._stroke = self.next_stroke
            self._first_seq = seq
            self._overrun_before = self.counts[counters.FRAMES_OVERRUN]
        if state == messages.STATE_LUMP_PASSED:
            value = strokes.lump_um
        elif state == messages.STATE_ENDED:
            value = strokes.frames
        elif state in (messages.STATE_FORCE_LOW, messages.STATE_FORCE_HIGH):
            value = strokes.force_mN_per_m
        elif state == messages.STATE_TOO_FAST:
            value = strokes.speed_um_per_s
        else:
            value = strokes.pressure_pa
        self._event_seq = (self._event_seq + 1) & 0xFFFF
        self._post(
            messages.TYPE["stroke_state"],
            (self._event_seq, self.stream.last, self._stroke, state, self.acquire.time_us, seq, value),
        )
        if state == messages.STATE_ENDED:
            self._end_stroke(seq)

    def _end_stroke(self, seq):
        self.next_stroke = (self._stroke + 1) & _MASK
        counters.add(self.counts, counters.STROKES, 1)
        if self.estimator:
            self.results.begin(self.stream.last, self._stroke)
            overrun = counters.elapsed(self.counts[counters.FRAMES_OVERRUN], self._overrun_before)
            self.estimator.finish(
                self.results,
                (self.strokes.frames, self._first_seq, seq, overrun, self.acquire.time_us),
                self.damage(),
            )
            counters.add(self.counts, counters.ESTIMATES, 1)
            memory.tidy()
            self.acquire.start(self.board.ticks_us())  # the time it took is no overrun

    def _count_down(self):
        """One stroke less to go, where so many were asked for."""
        if self.stream.strokes_left:
            self.stream.strokes_left -= 1
            if not self.stream.strokes_left:
                self._end_stream(messages.END_STROKES)

    # ---- what the commands change

    def start_stream(self, content, every=1, strokes=0, lease_ms=0):
        """Begin a stream of `content` (messages.CONTENT_...); False while a calibration is under way."""
        if self._measuring:
            return False
        self.box.drop_frames()
        self.results.quiet()
        self.strokes.reset()
        self.stream.start(content, every, strokes, lease_ms, self.board.ticks_us())
        self.board.begin()
        self.acquire.start(self.board.ticks_us())
        return True

    def stop_stream(self):
        """Send no more frames or strokes; a calibration under way is given up."""
        if self._measuring:
            self._end_measuring((status.BAD_STATE, (), b""))
        self.stream.end()
        self.strokes.reset()
        self.board.end()

    def _end_stream(self, reason):
        """The stream ends without having been told to; the host is told."""
        number = self.stream.number
        self.stop_stream()
        self._post(
            messages.TYPE["stream_end"],
            (number, reason, self.acquire.seq, self.next_stroke, self.board.ticks_us()),
        )

    def log(self, level, text):
        """Tell the host something in words (at most 200 bytes)."""
        self._post(messages.TYPE["log"], (level, self.board.ticks_us()), text.encode()[:200])

    def _post(self, kind, values, tail=b""):
        box = self.box
        length = messages.pack(box.body, kind, 0, 0, values, tail)
        kept = _KEPT_SHORT if length <= outbox.SHORT else _KEPT_LONG
        if box.room(length) <= kept or not box.post(box.body, length):
            counters.add(self.counts, counters.EVENTS_DROPPED, 1)


def run(board, estimator=None, notes=()):
    """Serve for ever; tell the host the notes (level, text).

    An error of the firmware's own is told too, and survived.
    """
    probe = Probe(board, estimator)
    for level, text in notes:
        probe.log(level, text)
    while True:
        try:
            board.idle(probe.step())
        except Exception as error:  # a probe that falls silent helps nobody
            probe.log(messages.LOG_ERROR, f"{type(error).__name__}: {error}")

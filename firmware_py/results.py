"""The last strokes' maps, features and estimates, sent until the host has them.

Which are kept: the estimates of the last 32 strokes, the features and maps of the last 3. A new one takes the
place of the oldest that was acknowledged, else of the oldest, which is then counted as given up.

Which are sent: those of the stream that began last, one at a time, when no other message waits for the link.
What was sent less often goes first; then features, estimates, maps; then the oldest stroke. What is not
acknowledged is sent again after `resend_results` ms, then after twice as long, and so on, TRIES times in all.
Then, as when another stream begins or another host identifies itself, it keeps quiet until it is asked for.
"""

from array import array

from firmware_py import counters, feature_chain, features, messages, outputs

TRIES = 6
_MOST_WAIT_MS = 60000
_FREE = 0  # nothing, or acknowledged
_QUIET = 1
_SENDING = 2
_ORDER = (1, 2, 0)  # of messages.HAVE_..., by bit
_ESTIMATES = 2
_LISTED = 20  # streams in the answer to `results`
# how many are kept of each, and the numbers behind its fields
_KEPT = (
    (messages.TYPE["map"], 3, feature_chain.POINTS),
    (messages.TYPE["features"], 3, features.COUNT),
    (messages.TYPE["estimate"], 32, outputs.VALUES),
)


class Ring:
    """Packed messages of one kind.

    Parameters: kind (its type), size (how many), numbers (how many stand behind its fields).
    """

    def __init__(self, kind, size, numbers):
        self.kind = kind
        self.longest = messages.size(kind, numbers)
        self.bodies = bytearray(size * self.longest)
        self.lengths = array("H", [0] * size)
        self.streams = array("i", [0] * size)
        self.strokes = array("i", [0] * size)
        self.due_us = array("i", [0] * size)
        self.tries = bytearray(size)
        self.state = bytearray(size)

    def place(self):
        """Where the next one goes: the oldest that nobody waits for, else the oldest."""
        best = 0
        for i in range(1, len(self.state)):
            if self.state[i] and not self.state[best]:
                continue
            if (self.state[best] and not self.state[i]) or self.older(i, best):
                best = i
        return best

    def older(self, i, j):
        return counters.elapsed(self.strokes[i], self.strokes[j]) < 0

    def find(self, stream, stroke):
        """Where the one of that stroke is, or -1."""
        for i in range(len(self.state)):
            if self.lengths[i] and self.strokes[i] == stroke and self.streams[i] == stream:
                return i
        return -1

    def due(self, now_us):
        """The one that is to be sent now, or -1. Allocates nothing."""
        best = -1
        for i in range(len(self.state)):
            if self.state[i] != _SENDING:
                continue
            if self.tries[i] and counters.elapsed(now_us, self.due_us[i]) < 0:
                continue
            if best < 0 or self.tries[i] < self.tries[best]:
                best = i
            elif self.tries[i] == self.tries[best] and self.older(i, best):
                best = i
        return best

    def waiting(self):
        """How many have not been acknowledged."""
        n = 0
        for state in self.state:
            if state:
                n += 1
        return n


class Results:
    """See above.

    Parameters: counts, box (outbox.Outbox), values (of the settings), setting (resend_results).
    """

    def __init__(self, counts, box, values, setting):
        self._counts = counts
        self._box = box
        self._values = values
        self._setting = setting
        self._rings = tuple([Ring(kind, size, numbers) for kind, size, numbers in _KEPT])
        self._sending = 0
        self.stream = 0
        self.stroke = 0

    def begin(self, stream, stroke):
        """What is put from here on belongs to this stroke."""
        self.stream = stream
        self.stroke = stroke

    def put(self, which, values, tail):
        """Pack one of the stroke's messages.

        which: 0 map, 1 features, 2 estimate; values: the fields behind stroke.
        """
        ring = self._rings[which]
        i = ring.place()
        if ring.state[i]:
            lost = counters.ESTIMATES_GIVEN_UP if which == _ESTIMATES else counters.MAPS_GIVEN_UP
            counters.add(self._counts, lost, 1)
            self._set(ring, i, _FREE)
        body = self._box.body
        n = messages.pack(body, ring.kind, 0, 0, (self.stream, self.stroke) + values, tail)
        at = i * ring.longest
        ring.bodies[at : at + n] = memoryview(body)[:n]
        ring.lengths[i] = n
        ring.streams[i] = self.stream
        ring.strokes[i] = self.stroke
        ring.tries[i] = 0
        self._set(ring, i, _SENDING)

    def _set(self, ring, i, state):
        self._sending += (state == _SENDING) - (ring.state[i] == _SENDING)
        ring.state[i] = state

    def acknowledge(self, stream, stroke, have):
        """The host has these (bits) of that stroke.

        The bits that it has not, or -1 if the probe does not remember the stroke.
        """
        missing = -1
        for which in range(len(self._rings)):
            ring = self._rings[which]
            i = ring.find(stream, stroke)
            if i < 0:
                continue
            missing = max(missing, 0)
            if have >> which & 1 and ring.state[i]:
                self._set(ring, i, _FREE)
                if which == _ESTIMATES:
                    counters.add(self._counts, counters.ESTIMATES_ACKNOWLEDGED, 1)
            if ring.state[i]:
                missing |= 1 << which
        return missing

    def quiet(self):
        """Send none unasked: another host has come, or another stream begins."""
        for ring in self._rings:
            for i in range(len(ring.state)):
                if ring.state[i]:
                    self._set(ring, i, _QUIET)

    def wake(self, stream, anew):
        """Send those of a stream that have not been acknowledged; anew: also those sent often enough."""
        for ring in self._rings:
            for i in range(len(ring.state)):
                if ring.state[i] == _QUIET and ring.streams[i] == stream:
                    if anew:
                        ring.tries[i] = 0
                    if ring.tries[i] < TRIES:
                        self._set(ring, i, _SENDING)

    def waiting(self):
        """Estimates that have not been acknowledged."""
        return self._rings[_ESTIMATES].waiting()

    def listed(self):
        """Streams with results that wait: of each its number, its oldest stroke and its newest."""
        rows = {}  # type: dict[int, tuple[int, int]]
        for ring in self._rings:
            for i in range(len(ring.state)):
                if ring.state[i]:
                    stroke = ring.strokes[i]
                    first, last = rows.get(ring.streams[i], (stroke, stroke))
                    if counters.elapsed(stroke, first) < 0:
                        first = stroke
                    if counters.elapsed(last, stroke) < 0:
                        last = stroke
                    rows[ring.streams[i]] = first, last
        out = []  # type: list[int]
        for stream in sorted(rows)[-_LISTED:]:
            out += (stream,) + rows[stream]
        return out

    def step(self, now_us):
        """Send one that is due, if the link has nothing more urgent. Allocates nothing."""
        if not self._sending or self._box.messages_waiting:
            return
        best = self._rings[0]
        at = 0
        tries = TRIES
        for which in _ORDER:
            ring = self._rings[which]
            i = ring.due(now_us)
            if i >= 0 and ring.tries[i] < tries:
                tries = ring.tries[i]
                at = i
                best = ring
        if tries < TRIES:
            self._send(best, at, now_us)

    def _send(self, ring, i, now_us):
        if not self._box.post(ring.bodies, ring.lengths[i], i * ring.longest):
            return
        if ring.tries[i]:
            counters.add(self._counts, counters.RESULTS_RESENT, 1)
        wait_ms = self._values[self._setting] << ring.tries[i]
        wait_ms = wait_ms if wait_ms < _MOST_WAIT_MS else _MOST_WAIT_MS
        ring.due_us[i] = (now_us + wait_ms * 1000) & counters.MASK
        ring.tries[i] += 1
        if ring.tries[i] >= TRIES:
            self._set(ring, i, _QUIET)

"""The stream that runs: its number, what it carries, and how long it goes on without a word from its host."""

from firmware_py import counters, messages

_BOOTS = 0x3FFF
_COUNT = 0xFFFF


class Stream:
    """One stream at a time.

    Parameters: boots, how often the probe has started. `number` is the running stream's, `last` that of the
    one that began last; none is used again within 2^16 streams of one start and 2^14 starts.
    """

    def __init__(self, boots):
        self._first = (boots & _BOOTS) << 16
        self._begun = 0
        self.number = 0
        self.last = 0
        self.content = 0
        self.lease_ms = messages.LEASE_MS
        self.strokes_left = 0
        self._every = 1
        self._skipped = 0
        self._heard_us = 0

    def start(self, content, every, strokes, lease_ms, now_us):
        """Begin another."""
        self._begun = self._begun % _COUNT + 1
        self.number = self.last = self._first | self._begun
        self.content = content
        self.strokes_left = strokes
        self.lease_ms = lease_ms or messages.LEASE_MS
        self._every = every or 1
        self._skipped = self._every - 1
        self._heard_us = now_us

    def end(self):
        """It is over; harmless when repeated."""
        self.number = 0
        self.content = 0
        self.strokes_left = 0

    def heard(self, now_us):
        """The host has said something: the lease begins anew."""
        self._heard_us = now_us

    def silent(self, now_us):
        """True when the lease is over. Allocates nothing."""
        return counters.elapsed(now_us, self._heard_us) > self.lease_ms * 1000

    def sends_frame(self):
        """True for the frames that are sent, asked once for each. Allocates nothing."""
        if not self.content & messages.CONTENT_FRAMES:
            return False
        self._skipped += 1
        if self._skipped < self._every:
            return False
        self._skipped = 0
        return True

    def watches_strokes(self):
        """True where strokes are looked for: to be told, or to be counted."""
        return self.content & messages.CONTENT_STROKES or self.strokes_left

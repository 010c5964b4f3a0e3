"""The last strokes' maps, features and estimates, sent until the host has them."""

from firmware_py import counters, messages, outbox

SLOTS = 4  # strokes remembered
TRIES = 20
_KINDS = ("map", "features", "estimate")


class Result:
    """One stroke's three messages, packed; `missing` is messages.HAVE_... bits not yet acknowledged."""

    def __init__(self):
        self.stroke = 0
        self.bodies = [bytearray(outbox.MESSAGE_BODY) for _ in _KINDS]
        self.lengths = [0, 0, 0]
        self.missing = 0
        self.due_us = 0
        self.tries = 0


class Results:
    """Sends each result, and again every `resend_results` ms, until acknowledged or tried often enough."""

    def __init__(self, counts, box, values, setting):
        self._counts = counts
        self._box = box
        self._values = values
        self._setting = setting
        self._slots = [Result() for _ in range(SLOTS)]
        self._next = 0

    def new(self, stroke):
        """The memory for a stroke's result; the oldest makes room."""
        result = self._slots[self._next]
        self._next = (self._next + 1) % SLOTS
        if result.missing:
            counters.add(self._counts, counters.RESULTS_REPLACED, 1)
        result.stroke = stroke
        result.missing = 0
        result.tries = 0
        return result

    def put(self, result, which, values, tail):
        """Pack one of a result's messages; which: 0 map, 1 features, 2 estimate."""
        kind = messages.TYPE[_KINDS[which]]
        result.lengths[which] = messages.pack(result.bodies[which], kind, 0, 0, values, tail)
        result.missing |= 1 << which

    def acknowledge(self, stroke, have):
        """The host has these (bits) of that stroke; True if the probe still remembered it."""
        for result in self._slots:
            if result.stroke == stroke:
                result.missing &= ~have
                return True
        return False

    def forget(self):
        """Send none of them again."""
        for result in self._slots:
            result.missing = 0

    def step(self, now_us):
        """Send what is due."""
        for result in self._slots:
            if not result.missing or result.tries > TRIES:
                continue
            if result.tries and counters.elapsed(now_us, result.due_us) < 0:
                continue
            for which in range(len(_KINDS)):
                if result.missing >> which & 1:
                    if not self._box.post(result.bodies[which], result.lengths[which]):
                        return
                    if result.tries:
                        counters.add(self._counts, counters.EVENTS_RESENT, 1)
            result.tries += 1
            wait_us = self._values[self._setting] * 1000
            result.due_us = (now_us + wait_us) & counters.MASK

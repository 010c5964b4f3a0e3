"""Takes commands apart, keeps each from being executed twice, and answers."""

from firmware_py import counters, messages, status

REMEMBERED = 4
UNKNOWN = 0xFF


def _small(fields):
    """True if every number stays within the wire's +-2**30."""
    for value in fields:
        if isinstance(value, int) and not -messages.WRAP < value < messages.WRAP:
            return False
    return True


class Commands:
    """Dispatches commands to `handlers`: type -> function(fields) -> (status, values, tail) or None.

    A handler that returns None answers later by `finish`; until then a repetition of its command is ignored.
    """

    def __init__(self, counts, box, handlers):
        self._counts = counts
        self._box = box
        self._handlers = handlers
        self._keys = [b""] * REMEMBERED
        self._answers = [b""] * REMEMBERED
        self._next = 0
        self._pending = None  # (type, id, key) of the command that will be answered later

    def forget(self):
        """Forget all answers (a new host has come); a pending command is left unanswered."""
        for i in range(REMEMBERED):
            self._keys[i] = b""
        self._pending = None

    def pending(self):
        """True while a command waits for its answer."""
        return self._pending is not None

    def take(self, packet, length):
        """Execute or answer again the command in packet[:length], behind which its CRC still stands."""
        if length < 3:
            self._send(UNKNOWN, 0, status.BAD_LENGTH, (), b"")
            return
        # type, id, last and first bytes, and CRC tell a repetition from an id that is used again
        key = bytes(packet[: length + 4])
        for i in range(REMEMBERED):
            if self._keys[i] == key:
                counters.add(self._counts, counters.COMMANDS_DUPLICATE, 1)
                self._box.post(self._answers[i], len(self._answers[i]))
                return
        kind = packet[0]
        number = messages.message_id(packet)
        if self._pending and self._pending[2] == key:
            counters.add(self._counts, counters.COMMANDS_DUPLICATE, 1)
            return
        handler = self._handlers.get(kind)
        if handler is None:
            self._send(UNKNOWN, number, status.BAD_TYPE, (), b"")
            return
        fields = messages.unpack(packet, length)
        if fields is None:
            self._send(kind | messages.ANSWER, number, status.BAD_LENGTH, (), b"")
            return
        if kind == messages.TYPE["identify"]:
            self.forget()
        elif not _small(fields):
            # a number that a 32-bit interpreter cannot hold in a word says nothing that we could do
            self._answer(kind, number, key, (status.BAD_VALUE, (), b""))
            return
        answer = handler(fields)
        if answer is None:
            self._pending = (kind, number, key)
        else:
            self._answer(kind, number, key, answer)

    def finish(self, answer):
        """Answer the pending command with (status, values, tail); nothing happens if none is."""
        if self._pending:
            kind, number, key = self._pending
            self._pending = None
            self._answer(kind, number, key, answer)

    def _answer(self, kind, number, key, answer):
        length = self._send(kind | messages.ANSWER, number, answer[0], answer[1], answer[2])
        self._keys[self._next] = key
        self._answers[self._next] = bytes(self._box.body[:length])
        self._next = (self._next + 1) % REMEMBERED
        if answer[0] >= 0:
            counters.add(self._counts, counters.COMMANDS, 1)

    def _send(self, kind, number, code, values, tail):
        if code < 0:
            counters.add(self._counts, counters.COMMANDS_REFUSED, 1)
        body = self._box.body
        length = messages.pack(body, kind, number, code, values, tail)
        self._box.post(body, length)
        return length

"""Commands as bytes, and a register of those that await an answer."""

from __future__ import annotations

import random
import threading
import time

from firmware_py import messages, status, wire
from palpate.errors import CommandRefused, UsageError
from palpate.wire.events import Answer

IDS = 1 << 16


def pack_command(name: str, number: int, values: tuple[int | bytes, ...] = (), tail: bytes = b"") -> bytes:
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
    keys = {row[1]: row[0] for row in messages.SETTINGS}
    if name not in keys:
        raise UsageError(f"there is no setting {name!r}; known are {', '.join(keys)}")
    return int(keys[name])


def check_answer(name: str, answer: Answer) -> Answer:
    """The answer itself, or `CommandRefused` with the probe's reason."""
    if answer.status < 0:
        reason = status.TEXT.get(answer.status, "for a reason this program does not know")
        raise CommandRefused(name, answer.status, reason)
    if answer.kind != messages.TYPE[name] | messages.ANSWER:
        raise CommandRefused(name, status.BAD_TYPE, status.TEXT[status.BAD_TYPE])
    return answer


class PendingCommands:
    """Which commands await an answer. Ids start at random, so that answers to an earlier host match none."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._answers: dict[int, Answer | None] = {}
        self._unawaited: dict[int, None] = {}
        self._next = random.randrange(IDS)

    def begin(self) -> int:
        """A new id whose answer will be awaited."""
        with self._changed:
            number = self._take_id()
            self._answers[number] = None
            return number

    def begin_unawaited(self) -> int:
        """A new id whose answer is accepted but not awaited (acknowledgements)."""
        with self._changed:
            number = self._take_id()
            self._unawaited[number] = None
            if len(self._unawaited) > 256:
                del self._unawaited[next(iter(self._unawaited))]
            return number

    def end(self, number: int) -> None:
        """This answer is no longer awaited: if it still comes, it is late."""
        with self._changed:
            self._answers.pop(number, None)

    def deliver(self, answer: Answer) -> bool:
        """Deliver an answer to its command; False if none awaits it."""
        with self._changed:
            number = answer.message_id
            if self._answers.get(number, answer) is None:
                self._answers[number] = answer
                self._changed.notify_all()
                return True
            return self._unawaited.pop(number, answer) is None

    def get(self, number: int) -> Answer | None:
        """The answer, if it has come."""
        return self._answers.get(number)

    def wait(self, number: int, timeout_s: float) -> Answer | None:
        """The answer, or None after `timeout_s` or a `wake`."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            while self._answers.get(number) is None:
                left = deadline - time.monotonic()
                if left <= 0 or not self._changed.wait(left):
                    break
            return self._answers.get(number)

    def wake(self) -> None:
        """The link has failed: stop waiting."""
        with self._changed:
            self._changed.notify_all()

    def _take_id(self) -> int:
        self._next = (self._next + 1) % IDS
        return self._next

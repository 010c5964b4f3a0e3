"""A plain host for the tests: commands out, messages in, nothing retried."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from firmware_py import messages, status, wire
from firmware_py.estimator import Estimator
from firmware_py.store import FileStore
from palpate.sim.probe.virtual import VirtualBoard, VirtualProbe


@dataclass
class Message:
    kind: int
    name: str
    number: int  # of a command's answer, else 0
    code: int  # status of an answer, else 0
    fields: dict


def command(name: str, number: int, values=(), tail=b"") -> bytes:
    """A command as it goes over the wire."""
    body, target = bytearray(1000), bytearray(1100)
    length = messages.pack(body, messages.TYPE[name], number, 0, values, tail)
    return bytes(target[: wire.seal(body, length, target, 1)])


def packet(body: bytes) -> bytes:
    """Any body as a packet."""
    target = bytearray(wire.wire_size(len(body)))
    return bytes(target[: wire.seal(bytearray(body + bytes(4)), len(body), target, 1)])


class ByteReceiver(wire.Receiver):
    """The parser as MicroPython runs it: byte by byte."""

    feed = wire.Receiver._feed_bytes


def receive(receiver: wire.Receiver, data: bytes) -> list[bytes]:
    """The packets that a parser finds in these bytes."""
    got, at = [], 0
    while at < len(data):
        at = receiver.feed(data, at, len(data))
        if receiver.length:
            got.append(bytes(receiver.packet[: receiver.length]))
    return got


class Ears:
    """Parses what a probe says."""

    def __init__(self) -> None:
        self.receiver = wire.Receiver(messages.FRAME_BODY)

    def hear(self, data: bytes) -> list[Message]:
        return [message(bytearray(body), len(body)) for body in receive(self.receiver, data)]


def message(body: bytearray, length: int) -> Message:
    values = messages.unpack(body, length)
    assert values is not None, bytes(body[:length])
    kind = body[0]
    _, name, _, names, tail = messages.TABLE[kind]
    keys = names.split() + (["tail"] if tail else [])
    answer = kind & messages.ANSWER
    return Message(
        kind,
        name,
        messages.message_id(body) if answer else 0,
        messages.answer_status(body) if answer else 0,
        dict(zip(keys, values, strict=False)),
    )


def send_model(ask: Callable[..., Message], image: bytes) -> bytes:
    """A model image goes over piece by piece, each command by `ask`; the name that it went by."""
    name = hashlib.sha256(image).digest()[:8]
    assert ask("flash_begin", (len(image), name)).code == status.OK
    for at in range(0, len(image), messages.FLASH_PIECE):
        assert ask("flash_data", (at,), image[at : at + messages.FLASH_PIECE]).code == status.OK
    return name


class Bench:
    """A virtual probe with a host beside it."""

    def __init__(self, board=None, estimator=None) -> None:
        self.probe = VirtualProbe(board, estimator)
        self.ears = Ears()
        self.heard: list[Message] = []
        self.number = 100

    @classmethod
    def measuring(cls, folder: Path, frames: bytes = b"", **link: int) -> "Bench":
        """Of a probe that makes estimates, whose files are in this folder."""
        return cls(VirtualBoard(frames, **link), Estimator(FileStore(str(folder))))

    def run(self, us: int) -> list[Message]:
        """Let time pass; what was said meanwhile."""
        self.probe.run(us)
        news = self.ears.hear(self.probe.take())
        self.heard += news
        return news

    def ask(self, name: str, values=(), tail=b"", us: int = 5000) -> Message:
        """A command and its answer."""
        self.number += 1
        self.probe.send(command(name, self.number, values, tail))
        answers = [m for m in self.run(us) if m.number == self.number and m.kind & messages.ANSWER]
        assert len(answers) == 1, f"{name}: {len(answers)} answers"
        return answers[0]

    def send(self, data: bytes, us: int = 5000) -> list[Message]:
        self.probe.send(data)
        return self.run(us)

"""Wires made up for tests: packets as a probe would send them."""

from __future__ import annotations

import numpy as np

from firmware_py import geometry, messages, outputs, wire


def packet(
    kind: str, values: tuple, tail: bytes | tuple = b"", number: int = 0, answer: bool = False
) -> bytes:
    """One packet of the probe's."""
    code = messages.TYPE[kind] | (messages.ANSWER if answer else 0)
    body = bytearray(2048)
    length = messages.pack(body, code, number, 0, values, tail)
    target = bytearray(2200)
    return bytes(target[: wire.seal(body, length, target, 0)])


def identified(boots: int = 1) -> bytes:
    """The answer to a handshake."""
    who = (7, messages.PROTOCOL, messages.SCHEMA, b"\0\2\0", b"MADE--UP")
    sensors = (16, 26, 1500, 12, 0)
    return packet("identify", (*who, *sensors, 1, -7, bytes(8), boots, 0, 0, 0), answer=True)


STREAM = 1 << 16 | 1


def start(next_seq: int = 0, next_stroke: int = 1) -> tuple:
    """The fields of the answer to stream_start."""
    return STREAM, next_seq, next_stroke, 0, 10_000


def stop(next_seq: int, next_stroke: int = 1) -> tuple:
    """Of the answer to stream_stop."""
    return STREAM, next_seq, next_stroke, 0


def started(next_seq: int = 0) -> bytes:
    """The answer to stream_start."""
    return packet("stream_start", start(next_seq), answer=True)


def frame(seq: int, time_us: int | None = None, rng: np.random.Generator | None = None) -> bytes:
    """A frame packet; its counts are random, or say its number."""
    counts = bytes([seq % 251 + 1]) * geometry.FRAME_BYTES if rng is None else rng.bytes(geometry.FRAME_BYTES)
    time_us = 5000 * seq if time_us is None else time_us
    place = (seq % messages.WRAP, time_us % messages.WRAP, 1000 * (seq % 50) - 25000, 2500 + seq % 7)
    return packet("frame", place, counts)


def estimate(stroke: int, first_seq: int = 0, frames: int = 10, **parts: tuple[float, ...]) -> bytes:
    """An estimate packet with made-up numbers; `parts`: value, low and high of an output."""
    values = [1_000_000 * (k + 1) for k in range(outputs.VALUES)]
    for name, span in parts.items():
        at = 3 * outputs.NAMES.index(name)
        values[at : at + 3] = [round(1_000_000 * part) for part in span]
    place = (frames, first_seq, first_seq + frames, 0, 5000 * (first_seq + frames))
    return packet(
        "estimate", (STREAM, stroke, 0, 3 | 2 << 2, 0, 900, 400, b"MODEL-ID", *place), tuple(values)
    )

"""Consistent overhead byte stuffing (Cheshire & Baker 1999): packets without zero bytes, closed by one.

The buffers belong to the caller and nothing is allocated. `encode` and `decode` are the plain loops on
MicroPython; CPython replaces `decode` by one that moves whole blocks (same results, by test).
"""

import sys

DELIMITER = 0


def worst_case(n):
    """Bytes that n encoded bytes can take at most, the closing zero included."""
    return n + n // 254 + 2


def encode(source, n, target, at):
    """Encode source[:n] into target from index `at` on, with a closing zero; return the index behind it."""
    code_at = at
    code = 1
    at += 1
    for i in range(n):
        byte = source[i]
        if byte:
            target[at] = byte
            at += 1
            code += 1
            if code == 255:
                target[code_at] = 255
                code_at = at
                at += 1
                code = 1
        else:
            target[code_at] = code
            code_at = at
            at += 1
            code = 1
    target[code_at] = code
    target[at] = DELIMITER
    return at + 1


def decode_plain(buffer, n):
    """Decode buffer[:n] (without its closing zero) in place; return the new length, or -1 if malformed."""
    at = 0
    out = 0
    while at < n:
        code = buffer[at]
        at += 1
        end = at + code - 1
        if code == 0 or end > n:
            return -1
        while at < end:
            byte = buffer[at]
            if byte == 0:
                return -1
            buffer[out] = byte
            out += 1
            at += 1
        if code < 255 and at < n:
            buffer[out] = 0
            out += 1
    return out


def decode_blocks(buffer, n):
    """`decode_plain` by whole blocks: faster where a slice costs less than a loop (CPython, the host)."""
    if buffer.find(0, 0, n) >= 0:
        return -1
    at = 0
    out = 0
    while at < n:
        code = buffer[at]
        at += 1
        end = at + code - 1
        if end > n:
            return -1
        buffer[out : out + code - 1] = buffer[at:end]
        out += code - 1
        at = end
        if code < 255 and at < n:
            buffer[out] = 0
            out += 1
    return out


decode = decode_blocks if sys.implementation.name == "cpython" else decode_plain

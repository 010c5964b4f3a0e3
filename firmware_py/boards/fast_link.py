"""The link's hot loops as machine code (viper): CRC-32 and COBS. Same bytes as crc.py and cobs.py.

The CRC goes by half bytes: 16 entries of the table do, and a board has better use for the other kilobyte.
`use()` puts them in the plain ones' place. Ports without a native compiler cannot import this file.
"""

from array import array

import micropython

from firmware_py import cobs, crc

# of a half byte, which the table has where it is the upper one
_LOW = array("H", [crc._LOW[i] for i in range(0, 256, 16)])
_HIGH = array("H", [crc._HIGH[i] for i in range(0, 256, 16)])


@micropython.viper
def _append(buffer: ptr8, n: int, low: ptr16, high: ptr16):  # type: ignore[name-defined]  # noqa: F821
    lo: int = 0xFFFF
    hi: int = 0xFFFF
    i: int = 0
    while i < n:
        lo ^= int(buffer[i])
        k: int = lo & 15
        lo = (lo >> 4 | (hi & 15) << 12) ^ int(low[k])
        hi = hi >> 4 ^ int(high[k])
        k = lo & 15
        lo = (lo >> 4 | (hi & 15) << 12) ^ int(low[k])
        hi = hi >> 4 ^ int(high[k])
        i += 1
    buffer[n] = (lo ^ 0xFFFF) & 255
    buffer[n + 1] = (lo ^ 0xFFFF) >> 8
    buffer[n + 2] = (hi ^ 0xFFFF) & 255
    buffer[n + 3] = (hi ^ 0xFFFF) >> 8


@micropython.viper
def _whole(buffer: ptr8, n: int, low: ptr16, high: ptr16) -> int:  # type: ignore[name-defined]  # noqa: F821
    lo: int = 0xFFFF
    hi: int = 0xFFFF
    i: int = 0
    while i < n:
        lo ^= int(buffer[i])
        k: int = lo & 15
        lo = (lo >> 4 | (hi & 15) << 12) ^ int(low[k])
        hi = hi >> 4 ^ int(high[k])
        k = lo & 15
        lo = (lo >> 4 | (hi & 15) << 12) ^ int(low[k])
        hi = hi >> 4 ^ int(high[k])
        i += 1
    if lo == 0x20E3 and hi == 0xDEBB:
        return 1
    return 0


@micropython.viper
def _encode(source: ptr8, n: int, target: ptr8, at: int) -> int:  # type: ignore[name-defined]  # noqa: F821
    code_at: int = at
    code: int = 1
    i: int = 0
    at += 1
    while i < n:
        byte: int = int(source[i])
        i += 1
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
    target[at] = 0
    return at + 1


def append(buffer: bytearray, n: int) -> int:
    """crc.append."""
    _append(buffer, n, _LOW, _HIGH)  # type: ignore[arg-type]
    return n + 4


def check(buffer: bytearray, n: int) -> bool:
    """crc.check."""
    return n >= crc.SIZE and _whole(buffer, n, _LOW, _HIGH) == 1  # type: ignore[arg-type]


def encode(source: bytearray, n: int, target: bytearray, at: int) -> int:
    """cobs.encode."""
    return _encode(source, n, target, at)  # type: ignore[arg-type]


def use() -> None:
    """Take the plain loops' place, after a trial of both on the same bytes."""
    trial = bytearray(364)
    for i in range(310):  # a run that is longer than one block of COBS, then zeros
        trial[i] = i % 255 + 1
    mine = bytearray(trial)
    crc.append_plain(trial, 300)
    append(mine, 300)
    if trial != mine:
        raise RuntimeError("viper CRC differs")
    for n in (304, 303, 3):
        if check(mine, n) != crc.check_plain(trial, n):
            raise RuntimeError("viper CRC differs")
    a = bytearray(400)
    b = bytearray(400)
    if cobs.encode(trial, 364, a, 0) != encode(trial, 364, b, 0) or a != b:
        raise RuntimeError("viper COBS differs")
    # the plain ones are given back
    crc.append = crc.append_plain = append
    crc.check = crc.check_plain = check
    crc._LOW, crc._HIGH = _LOW, _HIGH
    cobs.encode = encode

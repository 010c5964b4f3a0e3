"""CRC-32 (IEEE 802.3, the one of zlib) over caller-owned buffers, without a single 32-bit number.

A 32-bit integer is a heap allocation on a 32-bit MicroPython, so the register is two halves of 16 bits
and the checksum is written as four bytes, least significant first. `binascii.crc32` gives the same bytes
but returns a number that a locked heap refuses three times in four; only CPython uses it.
"""

import sys
from array import array

SIZE = 4


def _halves_of_table():
    low = array("H", bytearray(512))
    high = array("H", bytearray(512))
    lo = 1
    hi = 0
    bit = 128
    while bit:  # the entries of single bits; all others are sums of these
        odd = lo & 1
        lo = lo >> 1 | (hi & 1) << 15
        hi >>= 1
        if odd:
            lo ^= 0x8320
            hi ^= 0xEDB8
        for i in range(0, 256, 2 * bit):
            low[i + bit] = low[i] ^ lo
            high[i + bit] = high[i] ^ hi
        bit >>= 1
    return low, high


_LOW, _HIGH = _halves_of_table()
del _halves_of_table  # a board has no room for what is called once


def append_plain(buffer, n):
    """Write the CRC-32 of buffer[:n] to buffer[n:n + 4]; return n + 4."""
    lo = 0xFFFF
    hi = 0xFFFF
    low = _LOW
    high = _HIGH
    for i in range(n):
        k = (lo ^ buffer[i]) & 255
        lo = (lo >> 8 | (hi & 255) << 8) ^ low[k]
        hi = hi >> 8 ^ high[k]
    lo ^= 0xFFFF
    hi ^= 0xFFFF
    buffer[n] = lo & 255
    buffer[n + 1] = lo >> 8
    buffer[n + 2] = hi & 255
    buffer[n + 3] = hi >> 8
    return n + 4


def check_plain(buffer, n):
    """True if the last four bytes of buffer[:n] are the CRC-32 of the rest."""
    if n < SIZE:
        return False
    lo = 0xFFFF
    hi = 0xFFFF
    low = _LOW
    high = _HIGH
    for i in range(n):
        k = (lo ^ buffer[i]) & 255
        lo = (lo >> 8 | (hi & 255) << 8) ^ low[k]
        hi = hi >> 8 ^ high[k]
    return lo == 0x20E3 and hi == 0xDEBB  # the residue: CRC register after a message and its own CRC


if sys.implementation.name == "cpython":
    from binascii import crc32 as _crc32

    def append(buffer, n):
        """Write the CRC-32 of buffer[:n] to buffer[n:n + 4]; return n + 4."""
        buffer[n : n + SIZE] = _crc32(memoryview(buffer)[:n]).to_bytes(SIZE, "little")
        return n + SIZE

    def check(buffer, n):
        """True if the last four of buffer[:n] are the CRC-32 of what stands before them."""
        return n >= SIZE and _crc32(memoryview(buffer)[:n]) == 0x2144DF1C

else:
    append = append_plain
    check = check_plain

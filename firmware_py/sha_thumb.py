"""Nodes of hash trees (slh_dsa.py) by SHA-256 in Thumb machine code, written by hand; the same bytes.

A signature's check makes two thousand nodes, each of a first block of 64 bytes that is always the same, and a
second one. hashlib works through both, and each call of it takes memory. Here the first is done once. a to h,
W and K are those of FIPS 180-4. Ports without this assembler cannot import the file.
"""

# ruff: noqa: F821 - registers and instructions are the assembler's own words
# mypy: ignore-errors
# pyright: reportUndefinedVariable=false
import hashlib

import micropython

BLOCK = 64
_AT = 22  # a node's place in its block; the byte before it counts
_NODE = 16
_ROW = 16  # bytes: A, E, W and K, a row for each round
_ROUNDS = 64
_K = (
    b"\x98\x2f\x8a\x42\x91\x44\x37\x71\xcf\xfb\xc0\xb5\xa5\xdb\xb5\xe9\x5b\xc2\x56\x39"
    b"\xf1\x11\xf1\x59\xa4\x82\x3f\x92\xd5\x5e\x1c\xab\x98\xaa\x07\xd8\x01\x5b\x83\x12"
    b"\xbe\x85\x31\x24\xc3\x7d\x0c\x55\x74\x5d\xbe\x72\xfe\xb1\xde\x80\xa7\x06\xdc\x9b"
    b"\x74\xf1\x9b\xc1\xc1\x69\x9b\xe4\x86\x47\xbe\xef\xc6\x9d\xc1\x0f\xcc\xa1\x0c\x24"
    b"\x6f\x2c\xe9\x2d\xaa\x84\x74\x4a\xdc\xa9\xb0\x5c\xda\x88\xf9\x76\x52\x51\x3e\x98"
    b"\x6d\xc6\x31\xa8\xc8\x27\x03\xb0\xc7\x7f\x59\xbf\xf3\x0b\xe0\xc6\x47\x91\xa7\xd5"
    b"\x51\x63\xca\x06\x67\x29\x29\x14\x85\x0a\xb7\x27\x38\x21\x1b\x2e\xfc\x6d\x2c\x4d"
    b"\x13\x0d\x38\x53\x54\x73\x0a\x65\xbb\x0a\x6a\x76\x2e\xc9\xc2\x81\x85\x2c\x72\x92"
    b"\xa1\xe8\xbf\xa2\x4b\x66\x1a\xa8\x70\x8b\x4b\xc2\xa3\x51\x6c\xc7\x19\xe8\x92\xd1"
    b"\x24\x06\x99\xd6\x85\x35\x0e\xf4\x70\xa0\x6a\x10\x16\xc1\xa4\x19\x08\x6c\x37\x1e"
    b"\x4c\x77\x48\x27\xb5\xbc\xb0\x34\xb3\x0c\x1c\x39\x4a\xaa\xd8\x4e\x4f\xca\x9c\x5b"
    b"\xf3\x6f\x2e\x68\xee\x82\x8f\x74\x6f\x63\xa5\x78\x14\x78\xc8\x84\x08\x02\xc7\x8c"
    b"\xfa\xff\xbe\x90\xeb\x6c\x50\xa4\xf7\xa3\xf9\xbe\xf2\x78\x71\xc6"
)
_START = (
    b"\x67\xe6\x09\x6a\x85\xae\x67\xbb\x72\xf3\x6e\x3c\x3a\xf5\x4f\xa5\x7f\x52\x0e\x51"
    b"\x8c\x68\x05\x9b\xab\xd9\x83\x1f\x19\xcd\xe0\x5b"
)


@micropython.asm_thumb
def _nodes(r0, r1, r2, r3):
    """As often as r3 says: the node of the second block r1, behind the state r2, into its place; r0: rows.

    Rows hold a's and e's history: round i finds d, c, b, a in rows i to i + 3 (h to e, too) and writes row
    i + 4, so that nothing is moved.
    """
    push({r0, r1, r2, r3})
    label(NEXT)
    mov(r7, sp)
    ldr(r0, [r7, 0])
    ldr(r1, [r7, 4])
    ldr(r2, [r7, 8])
    # A and E before the first round
    ldr(r3, [r2, 12])
    str(r3, [r0, 0])
    ldr(r3, [r2, 8])
    str(r3, [r0, 16])
    ldr(r3, [r2, 4])
    str(r3, [r0, 32])
    ldr(r3, [r2, 0])
    str(r3, [r0, 48])
    ldr(r3, [r2, 28])
    str(r3, [r0, 4])
    ldr(r3, [r2, 24])
    str(r3, [r0, 20])
    ldr(r3, [r2, 20])
    str(r3, [r0, 36])
    ldr(r3, [r2, 16])
    str(r3, [r0, 52])
    # W: the block's sixteen words
    mov(r5, 16)
    label(LOAD)
    ldr(r3, [r1, 0])
    data(2, 0xBA1B)  # rev(r3, r3): its bytes the other way round
    str(r3, [r0, 8])
    add(r0, 16)
    add(r1, 4)
    sub(r5, 1)
    bne(LOAD)
    # and the other 48; r1 lies nine rows behind r0
    ldr(r0, [r7, 0])
    mov(r1, r0)
    add(r1, 144)
    mov(r7, 48)
    label(EXTEND)
    ldr(r3, [r0, 24])
    mov(r4, r3)
    mov(r5, 11)
    ror(r4, r5)
    eor(r4, r3)
    mov(r5, 7)
    ror(r4, r5)
    lsr(r3, r3, 3)
    eor(r4, r3)
    ldr(r3, [r1, 88])
    mov(r5, r3)
    mov(r6, 2)
    ror(r5, r6)
    eor(r5, r3)
    mov(r6, 17)
    ror(r5, r6)
    lsr(r3, r3, 10)
    eor(r5, r3)
    add(r4, r4, r5)
    ldr(r3, [r0, 8])
    add(r4, r4, r3)
    ldr(r3, [r1, 8])
    add(r4, r4, r3)
    str(r4, [r1, 120])
    add(r0, 16)
    add(r1, 16)
    sub(r7, 1)
    bne(EXTEND)
    mov(r7, sp)
    ldr(r0, [r7, 0])
    mov(r7, 64)
    label(ROUND)
    ldr(r1, [r0, 52])  # Ch(e, f, g)
    ldr(r2, [r0, 36])
    ldr(r3, [r0, 20])
    eor(r2, r3)
    and_(r2, r1)
    eor(r2, r3)
    mov(r3, r1)  # e turned by 6, 11 and 25
    mov(r4, 14)
    ror(r3, r4)
    eor(r3, r1)
    mov(r4, 5)
    ror(r3, r4)
    eor(r3, r1)
    mov(r4, 6)
    ror(r3, r4)
    add(r2, r2, r3)
    ldr(r3, [r0, 4])  # h, W, K
    add(r2, r2, r3)
    ldr(r3, [r0, 8])
    add(r2, r2, r3)
    ldr(r3, [r0, 12])
    add(r2, r2, r3)
    ldr(r3, [r0, 0])  # the next e
    add(r3, r3, r2)
    str(r3, [r0, 68])
    ldr(r1, [r0, 48])  # Maj(a, b, c)
    ldr(r3, [r0, 32])
    ldr(r4, [r0, 16])
    eor(r4, r3)
    mov(r5, r1)
    eor(r5, r3)
    and_(r4, r5)
    eor(r4, r3)
    add(r2, r2, r4)
    mov(r3, r1)  # a turned by 2, 13 and 22
    mov(r4, 9)
    ror(r3, r4)
    eor(r3, r1)
    mov(r4, 11)
    ror(r3, r4)
    eor(r3, r1)
    mov(r4, 2)
    ror(r3, r4)
    add(r2, r2, r3)  # the next a
    str(r2, [r0, 64])
    add(r0, 16)
    sub(r7, 1)
    bne(ROUND)
    # the first four words of the new state are the node
    mov(r7, sp)
    ldr(r1, [r7, 4])
    ldr(r2, [r7, 8])
    ldr(r3, [r0, 48])
    ldr(r4, [r2, 0])
    add(r3, r3, r4)
    data(2, 0xBA1B)
    strh(r3, [r1, 22])
    lsr(r3, r3, 16)
    strh(r3, [r1, 24])
    ldr(r3, [r0, 32])
    ldr(r4, [r2, 4])
    add(r3, r3, r4)
    data(2, 0xBA1B)
    strh(r3, [r1, 26])
    lsr(r3, r3, 16)
    strh(r3, [r1, 28])
    ldr(r3, [r0, 16])
    ldr(r4, [r2, 8])
    add(r3, r3, r4)
    data(2, 0xBA1B)
    strh(r3, [r1, 30])
    lsr(r3, r3, 16)
    strh(r3, [r1, 32])
    ldr(r3, [r0, 0])
    ldr(r4, [r2, 12])
    add(r3, r3, r4)
    data(2, 0xBA1B)
    strh(r3, [r1, 34])
    lsr(r3, r3, 16)
    strh(r3, [r1, 36])
    ldrb(r3, [r1, 21])
    add(r3, 1)
    strb(r3, [r1, 21])
    ldr(r3, [r7, 12])
    sub(r3, 1)
    str(r3, [r7, 12])
    beq(END)
    b(NEXT)
    label(END)
    pop({r0, r1, r2, r3})
    mov(r0, 0)


class Nodes:
    """Makes nodes behind one first block of 64 bytes. Raises ValueError where its bytes are not hashlib's."""

    def __init__(self, first):
        rows = bytearray(_ROW * (_ROUNDS + 4))
        for i in range(_ROUNDS):
            rows[_ROW * i + 12 : _ROW * i + 16] = _K[4 * i : 4 * i + 4]
        self._rows = rows
        state = bytearray(_START)
        _nodes(rows, bytearray(first), state, 1)
        for i in range(8):  # the state after it: a to h lie in the last four rows, backwards
            at = _ROW * (_ROUNDS + 3 - i % 4) + i // 4 * 4
            word = int.from_bytes(rows[at : at + 4], "little") + int.from_bytes(
                _START[4 * i : 4 * i + 4], "little"
            )
            state[4 * i : 4 * i + 4] = (word & 0xFFFFFFFF).to_bytes(4, "little")
        self._state = state
        for size in (38, 54):
            buffer = bytearray(first) + bytearray(BLOCK)
            for i in range(size):
                buffer[BLOCK + i] = 37 * i & 255
            pad(buffer, BLOCK + size)
            node = hashlib.sha256(memoryview(buffer)[: BLOCK + size]).digest()[:_NODE]
            self.nodes(buffer, BLOCK + size, 1)
            if buffer[BLOCK + _AT : BLOCK + _AT + _NODE] != node:
                raise ValueError("other bytes")

    def nodes(self, buffer, _size, n):
        """n times: the node of `buffer`, 128 bytes of which `pad` has ended the message, into its place."""
        if n:
            _nodes(self._rows, memoryview(buffer)[BLOCK:], self._state, n)


def pad(buffer, size):
    """The end of a message of `size` bytes in two blocks: a bit, zeros, and how many bits."""
    buffer[size] = 128
    buffer[2 * BLOCK - 2] = size >> 5
    buffer[2 * BLOCK - 1] = size << 3 & 255

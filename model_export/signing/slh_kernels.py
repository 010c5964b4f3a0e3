"""SHA-256 as SLH-DSA uses it two million times a signature, compiled: one block behind the seed's.

Everything is bytes in uint8 arrays; an address is the 22 bytes of FIPS 205, 11.2.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

N = 16
CHAINS = 35
WORD = 0xFFFFFFFF


def _roots(power: int) -> list[int]:
    """First 32 bits behind the point of the square or cube roots of the first 64 primes (FIPS 180-4)."""
    primes = [n for n in range(2, 312) if all(n % k for k in range(2, int(n**0.5) + 1))]
    out = []
    for p in primes:
        wanted, low, high = p << 32 * power, 0, 1 << 40
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if middle**power <= wanted else (low, middle)
        out.append(low & WORD)
    return out


_K = np.array(_roots(3), np.int64)
START = np.array(_roots(2)[:8], np.int64)


@njit(cache=True, nogil=True, inline="always")
def _turn(x, n):
    return (x >> n | x << (32 - n)) & WORD


@njit(cache=True, nogil=True)
def compress(state, block, w, out):
    """One block of 64 bytes into `out` (8 words), from `state`; w: 64 words of working space."""
    for i in range(16):
        w[i] = block[4 * i] << 24 | block[4 * i + 1] << 16 | block[4 * i + 2] << 8 | block[4 * i + 3]
    for i in range(16, 64):
        p = w[i - 15]
        q = w[i - 2]
        s = _turn(p, 7) ^ _turn(p, 18) ^ (p >> 3)
        t = _turn(q, 17) ^ _turn(q, 19) ^ (q >> 10)
        w[i] = (w[i - 16] + s + w[i - 7] + t) & WORD
    a, b, c, d = state[0], state[1], state[2], state[3]
    e, f, g, h = state[4], state[5], state[6], state[7]
    for i in range(64):
        s = _turn(e, 6) ^ _turn(e, 11) ^ _turn(e, 25)
        t = h + s + ((e & f) ^ (~e & g)) + _K[i] + w[i]
        s = _turn(a, 2) ^ _turn(a, 13) ^ _turn(a, 22)
        v = s + ((a & b) ^ (a & c) ^ (b & c))
        h, g, f, e = g, f, e, (d + t) & WORD
        d, c, b, a = c, b, a, (t + v) & WORD
    out[0] = (state[0] + a) & WORD
    out[1] = (state[1] + b) & WORD
    out[2] = (state[2] + c) & WORD
    out[3] = (state[3] + d) & WORD
    out[4] = (state[4] + e) & WORD
    out[5] = (state[5] + f) & WORD
    out[6] = (state[6] + g) & WORD
    out[7] = (state[7] + h) & WORD


@njit(cache=True, nogil=True)
def node(state, address, message, out, space):
    """`out` (16 bytes) becomes the hash of seed, address and message; space: 144 words."""
    block = space[:64]
    w = space[64:128]
    now = space[128:136]
    total = 22 + len(message)
    for i in range(8):
        now[i] = state[i]
    at = 0
    for i in range(22):
        block[i] = address[i]
    at = 22
    for byte in message:
        block[at] = byte
        at += 1
        if at == 64:
            compress(now, block, w, now)
            at = 0
    block[at] = 128
    at += 1
    if at > 56:
        for i in range(at, 64):
            block[i] = 0
        compress(now, block, w, now)
        at = 0
    for i in range(at, 64):
        block[i] = 0
    bits = 8 * (64 + total)
    block[61] = bits >> 16 & 255
    block[62] = bits >> 8 & 255
    block[63] = bits & 255
    compress(now, block, w, now)
    for i in range(4):
        for k in range(4):
            out[4 * i + k] = now[i] >> (24 - 8 * k) & 255


@njit(cache=True, nogil=True)
def _word(address, at, value):
    for k in range(4):
        address[at + k] = value >> (24 - 8 * k) & 255


@njit(cache=True, nogil=True)
def chain(state, secret, address, number, first, last, out, space):
    """Element `last` of a one-time key's chain: from its secret start (first < 0), or on from `out`."""
    _word(address, 14, number)
    _word(address, 18, 0)
    if first < 0:
        address[9] = 5
        node(state, address, secret, out, space)
        first = 0
    address[9] = 0
    for step in range(first, last):
        _word(address, 18, step)
        node(state, address, out, out, space)


@njit(cache=True, nogil=True)
def one_time_leaf(state, secret, address, leaf, out, space):
    """Node of a tree's leaf: hash of the ends of its 35 chains."""
    ends = np.empty(N * CHAINS, np.uint8)
    _word(address, 10, leaf)
    for i in range(CHAINS):
        chain(state, secret, address, i, -1, 15, ends[N * i : N * i + N], space)
    address[9] = 1
    _word(address, 14, 0)
    _word(address, 18, 0)
    node(state, address, ends, out, space)


@njit(cache=True, nogil=True)
def _grow(state, address, kind, first, nodes, height, space):
    """All nodes of a tree above its leaves, nodes[2^height ..], the root in nodes[1]."""
    address[9] = kind
    for level in range(1, height + 1):
        count = 1 << (height - level)
        for i in range(count):
            _word(address, 14, level)
            _word(address, 18, (first >> level) + i)
            k = count + i
            node(state, address, nodes[2 * k : 2 * k + 2].ravel(), nodes[k], space)


@njit(cache=True, nogil=True)
def tree(state, secret, address, height):
    """Nodes (2^(height + 1), 16) of the tree of one-time keys at an address (layer and tree set)."""
    space = np.zeros(144, np.int64)
    count = 1 << height
    nodes = np.zeros((2 * count, N), np.uint8)
    for leaf in range(count):
        one_time_leaf(state, secret, address, leaf, nodes[count + leaf], space)
    _word(address, 10, 0)
    _grow(state, address, 2, 0, nodes, height, space)
    return nodes


@njit(cache=True, nogil=True)
def one_time_signature(state, secret, address, leaf, digits):
    """The 35 chains at their digits, (560,)."""
    space = np.zeros(144, np.int64)
    out = np.empty(N * CHAINS, np.uint8)
    _word(address, 10, leaf)
    for i in range(CHAINS):
        chain(state, secret, address, i, -1, digits[i], out[N * i : N * i + N], space)
    return out


@njit(cache=True, nogil=True)
def few_times_tree(state, secret, address, leaf, number, depth):
    """Secrets (2^depth, 16) and nodes (2^(depth + 1), 16) of one few-time tree (FORS)."""
    space = np.zeros(144, np.int64)
    count = 1 << depth
    secrets = np.empty((count, N), np.uint8)
    nodes = np.zeros((2 * count, N), np.uint8)
    _word(address, 10, leaf)
    for i in range(count):
        _word(address, 14, 0)
        _word(address, 18, number * count + i)
        address[9] = 6
        node(state, address, secret, secrets[i], space)
        address[9] = 3
        node(state, address, secrets[i], nodes[count + i], space)
    _grow(state, address, 3, number * count, nodes, depth, space)
    return secrets, nodes

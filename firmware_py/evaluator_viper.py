"""The evaluator's loops once more in viper: machine code, and the same integers, on boards that have it.

    from firmware_py import evaluator_viper
    evaluator_viper.install()

See hot_viper.py, its fellow for the frames. Viper reads 16-bit words without their sign, hence the
`(x ^ 0x8000) - 0x8000`. Its integers wrap silently at 32 bits; the exporter proves that none gets there.
"""

# ruff: noqa: F821 - ptr8, ptr16 and ptr32 are viper's own
import micropython

from firmware_py import evaluator


@micropython.viper
def dot(c: ptr16, d, at: int, high: ptr16, low: ptr16, first: int, n: int, bits: int) -> int:
    """See evaluator.dot."""
    a = 0
    b = 0
    n += first
    if bits <= 8:
        bytes_ = ptr8(d)
        while first < n:
            x = (c[at] ^ 0x8000) - 0x8000
            h = (high[first] ^ 0x8000) - 0x8000
            a += x * h
            b += x * low[first] + ((bytes_[at] ^ 0x80) - 0x80) * h
            at += 1
            first += 1
    else:
        words = ptr16(d)
        while first < n:
            x = (c[at] ^ 0x8000) - 0x8000
            h = (high[first] ^ 0x8000) - 0x8000
            a += x * h
            b += x * low[first] + ((words[at] ^ 0x8000) - 0x8000) * h
            at += 1
            first += 1
    return a + (b >> bits)


@micropython.viper
def dot_high(c: ptr16, at: int, high: ptr16, first: int, n: int) -> int:
    """See evaluator.dot_high."""
    a = 0
    n += at
    while at < n:
        a += ((c[at] ^ 0x8000) - 0x8000) * ((high[first] ^ 0x8000) - 0x8000)
        at += 1
        first += 1
    return a


@micropython.viper
def multiply(steps: ptr8, n: int, terms: int, bits: int, u: ptr32, high: ptr16, low: ptr16):
    """See evaluator.multiply."""
    at = 0
    k = 5 + n
    mask = (1 << bits) - 1
    down = 15 - bits
    i = n
    while i < terms:
        v = u[steps[at]]
        w = u[steps[at + 1]]
        a = v >> 14
        b = w >> 14
        v &= 16383
        w &= 16383
        v = a * b + ((a * w + v * b + (v * w >> 14)) >> 14)
        u[i] = v
        high[k] = v >> 15
        low[k] = (v >> down) & mask
        at += 2
        k += 1
        i += 1


def install():
    """Put them in the place of the plain loops."""
    evaluator.dot = dot
    evaluator.dot_high = dot_high
    evaluator.multiply = multiply

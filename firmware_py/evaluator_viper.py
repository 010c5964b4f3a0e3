"""The evaluator's loops once more in viper: machine code, and the same integers, on boards that have it.

    from firmware_py import evaluator_viper
    evaluator_viper.install()

See hot_viper.py, its fellow for the frames. Viper reads 16-bit words without their sign, hence the
`(x ^ 0x8000) - 0x8000`. Its integers wrap silently at 32 bits; the exporter proves that none gets there.
"""

# ruff: noqa: F821 - ptr8, ptr16 and ptr32 are viper's own
import micropython

from firmware_py import polynomial


@micropython.viper
def sums(
    c: ptr16, d: ptr16, at: int, part: ptr32, high: ptr32, steps: ptr8, first: int, last: int,
    low_sum_shift: int, downs: int, work: ptr32, to: int, n: int,
):  # fmt: skip
    """See polynomial.sums; one output after the other, since registers are few."""
    j = 0
    while j < n:
        a = 0
        b = 0
        i = at + j
        k = first
        while k < last:
            a += ((c[i] ^ 0x8000) - 0x8000) * part[steps[k]]
            b += ((d[i] ^ 0x8000) - 0x8000) * high[steps[k]]
            i += n
            k += 1
        work[to + j] += (a + (b >> low_sum_shift)) >> (downs & 15)
        downs >>= 4
        j += 1


@micropython.viper
def carry(own: ptr32, at: int, u: int, base: int, work: ptr32, n: int):
    """See polynomial.carry."""
    a = u >> 14
    b = u & 16383
    j = base
    while j < base + n:
        v = work[j] + own[at]
        work[j] = 0
        w = v >> 14
        work[j - n] += a * w + ((a * (v & 16383) + b * w) >> 14)
        at += 1
        j += 1


@micropython.viper
def dot_high(c: ptr16, at: int, high: ptr32, first: int, n: int) -> int:
    """See polynomial.dot_high."""
    a = 0
    n += at
    while at < n:
        a += ((c[at] ^ 0x8000) - 0x8000) * high[first]
        at += 1
        first += 1
    return a


def install():
    """Put them in the place of the plain loops."""
    polynomial.sums = sums
    polynomial.carry = carry
    polynomial.dot_high = dot_high

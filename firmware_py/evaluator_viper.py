"""The evaluator's loops once more in viper: machine code, and the same integers, on boards that have it.

    from firmware_py import evaluator_viper
    evaluator_viper.install()

See hot_viper.py, its fellow for the frames. Viper reads 16-bit words without their sign, hence the
`(x ^ 0x8000) - 0x8000`. Its integers wrap silently at 32 bits; the exporter proves that none gets there.
"""

# ruff: noqa: F821 - ptr8, ptr16 and ptr32 are viper's own
import micropython

from firmware_py import constant, polynomial

const = constant.const

_LOW_BITS = const(3)  # as in polynomial.py
_PART_BITS = const(11)
_HIGH_BITS = const(12)
_SUMS = const(14)


@micropython.viper
def nested(
    c: ptr16, d: ptr16, own: ptr32, steps: ptr8, u: ptr32, part: ptr32, high: ptr32, head: ptr32, work: ptr32,
    i: int, last: int, at: int, downs: int,
):  # fmt: skip
    """See polynomial.nested; one output after the other, since registers are few."""
    n = head[_SUMS]
    low_sum_shift = head[_LOW_BITS] + head[_HIGH_BITS] - head[_PART_BITS]
    branch = 0
    while i < last:
        v = steps[i]
        to = n * ((v >> 5) & 3)
        i += 1
        if v & 128:
            a = u[steps[i]] >> 14
            b = u[steps[i]] & 16383
            i += 1
            end = to + n
            while to < end:
                v = work[to] + own[branch]
                work[to] = 0
                w = v >> 14
                work[to - n] += a * w + ((a * (v & 16383) + b * w) >> 14)
                branch += 1
                to += 1
        else:
            end = i + (v & 31)
            j = 0
            while j < n:
                a = 0
                b = 0
                w = at + j
                k = i
                while k < end:
                    a += ((c[w] ^ 0x8000) - 0x8000) * part[steps[k]]
                    b += ((d[w] ^ 0x8000) - 0x8000) * high[steps[k]]
                    w += n
                    k += 1
                work[to + j] += (a + (b >> low_sum_shift)) >> ((downs >> (4 * j)) & 15)
                j += 1
            at += n * (end - i)
            i = end


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
    polynomial.nested = nested
    polynomial.dot_high = dot_high

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
def sums(
    c: ptr16, d: ptr16, at: int, part: ptr32, high: ptr16, rest: ptr16, first: int, last: int, cut: int,
    fine: int, down: int, work: ptr32,
):  # fmt: skip
    """See evaluator.sums; one output after the other, since registers are few."""
    j = 0
    while j < 5:
        a = 0
        b = 0
        i = at + j
        k = first
        while k < last:
            x = (c[i] ^ 0x8000) - 0x8000
            h = (high[k] ^ 0x8000) - 0x8000
            b += ((d[i] ^ 0x8000) - 0x8000) * h
            if fine:
                a += x * h
                b += x * rest[k]
            else:
                a += x * part[k]
            i += 5
            k += 1
        work[j] += (a + (b >> cut)) >> down
        j += 1


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
def multiply(steps: ptr8, first: int, last: int, cut: int, part: ptr32, high: ptr16):
    """See evaluator.multiply."""
    at = 0
    k = first
    while k < last:
        v = part[steps[at] + 5]
        w = part[steps[at + 1] + 5]
        v = (v * (w >> 10) + (v * (w & 1023) >> 10)) >> (cut + 3)
        part[k] = v
        high[k] = v >> cut
        at += 2
        k += 1


@micropython.viper
def multiply_fine(steps: ptr8, n: int, terms: int, bits: int, u: ptr32, high: ptr16, rest: ptr16):
    """See evaluator.multiply_fine."""
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
        v = a * b + ((a * (w & 16383) + b * (v & 16383)) >> 14)
        u[i] = v
        high[k] = v >> 15
        rest[k] = (v >> down) & mask
        at += 2
        k += 1
        i += 1


def install():
    """Put them in the place of the plain loops."""
    evaluator.sums = sums
    evaluator.dot_high = dot_high
    evaluator.multiply = multiply
    evaluator.multiply_fine = multiply_fine

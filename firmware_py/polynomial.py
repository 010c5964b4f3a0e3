"""Polynomials of the same features, one for each output, all at once, nested, in integers.

A polynomial is a tree: y = sum over i of u_i * (c_i + sum over j >= i of c_ij * u_j), and so on inwards for
degree 3. Where a term goes no further it is a *leaf*; the terms behind a common factor are a *branch*. Only
a branch's value needs the full product with its feature: a leaf's two words meet two parts of its feature.

A coefficient is a high word c and a low word d. Of an input, +-1 in Q28, there are `part`, its first 18 to 22
bits, and `high`, its first 14 or 15, both rounded. A leaf is c * part and, shifted to the same scale,
d * high. The program, `steps`, is bytes, innermost branches first:

    n + 32 * depth, n inputs         add a run of n leaves to the branch at `depth`
    128 + 32 * depth, feature        close that branch: times the feature, into the one at depth - 1

Words of coefficients stand in the program's order, one an output for each leaf; a branch's own
coefficients, which come in as it is closed, are whole numbers at the scale of its sum. There are head[SUMS]
outputs, n, and the sums of a depth are kept in work[n * depth..].
"""

from firmware_py import constant

const = constant.const

OUTPUTS = const(6)  # outputs.COUNT; so many `sums` takes one by one
ALL_DOWNS = const(0xFFFFFF)  # four bits for each of them
# entries of the head
DOWNS = const(2)
LOW_BITS = const(3)
PART_BITS = const(11)
HIGH_BITS = const(12)
STEPS = const(13)
SUMS = const(14)


def few(c, d, at, part, high, steps, first, last, low_sum_shift, downs, work, to, n):
    """As `sums`, of any number n of outputs."""
    for j in range(n):
        a = 0
        b = 0
        i = at + j
        for k in range(first, last):
            h = steps[k]
            a += c[i] * part[h]
            b += d[i] * high[h]
            i += n
        work[to + j] += a + (b >> low_sum_shift) >> (downs & 15)
        downs >>= 4


def sums(c, d, at, part, high, steps, first, last, low_sum_shift, downs, work, to, n):
    """Add n outputs' sums over the inputs steps[first..last-1] to work[to..]; their words begin at `at`.

    Each is shifted down by its four bits of `downs`, and low words' products by `low_sum_shift` before.

    All at once: an input is read once, and a look-up costs as much as a product.
    """
    if n != OUTPUTS:
        few(c, d, at, part, high, steps, first, last, low_sum_shift, downs, work, to, n)
        return
    a0 = a1 = a2 = a3 = a4 = a5 = 0
    b0 = b1 = b2 = b3 = b4 = b5 = 0
    i = at
    for k in range(first, last):
        h = steps[k]
        v = part[h]
        h = high[h]
        a0 += c[i] * v
        b0 += d[i] * h
        i += 1
        a1 += c[i] * v
        b1 += d[i] * h
        i += 1
        a2 += c[i] * v
        b2 += d[i] * h
        i += 1
        a3 += c[i] * v
        b3 += d[i] * h
        i += 1
        a4 += c[i] * v
        b4 += d[i] * h
        i += 1
        a5 += c[i] * v
        b5 += d[i] * h
        i += 1
    a0 += b0 >> low_sum_shift
    a1 += b1 >> low_sum_shift
    a2 += b2 >> low_sum_shift
    a3 += b3 >> low_sum_shift
    a4 += b4 >> low_sum_shift
    a5 += b5 >> low_sum_shift
    if downs:
        a0 >>= downs & 15
        a1 >>= downs >> 4 & 15
        a2 >>= downs >> 8 & 15
        a3 >>= downs >> 12 & 15
        a4 >>= downs >> 16 & 15
        a5 >>= downs >> 20 & 15
    work[to] += a0
    work[to + 1] += a1
    work[to + 2] += a2
    work[to + 3] += a3
    work[to + 4] += a4
    work[to + 5] += a5


def carry(own, at, u, base, work, n):
    """A branch of n outputs, their sums work[base..], times u into the branches before; empties them."""
    a = u >> 14
    b = u & 16383
    for j in range(base, base + n):
        v = work[j] + own[at]
        work[j] = 0
        w = v >> 14
        # the product of the two low halves is below what is kept
        work[j - n] += a * w + (a * (v & 16383) + b * w >> 14)
        at += 1


def nested(c, d, own, steps, u, part, high, head, work):
    """All of it, the outputs' sums into work[0..]. The features are the inputs from OUTPUTS on."""
    outputs = head[SUMS]
    for i in range(3 * outputs):
        work[i] = 0
    at = 0
    branch = 0
    low_sum_shift = head[LOW_BITS] + head[HIGH_BITS] - head[PART_BITS]
    downs = head[DOWNS] & ALL_DOWNS
    last = head[STEPS]
    i = 0
    while i < last:
        n = steps[i]
        base = outputs * (n >> 5 & 3)
        i += 1
        if n & 128:
            carry(own, branch, u[steps[i]], base, work, outputs)
            branch += outputs
            i += 1
        else:
            n &= 31
            sums(c, d, at, part, high, steps, i, i + n, low_sum_shift, downs, work, base, outputs)
            i += n
            at += outputs * n


def dot_high(c, at, high, first, n):
    """One sum with high words alone, good to 1e-3 of the largest coefficient."""
    a = 0
    for k in range(first, first + n):
        a += c[at] * high[k]
        at += 1
    return a

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

All of it is one function: MicroPython puts the variables of a large function on the heap at each call, and on
a heap with gaps finding room for them takes longer than a run of sums.
"""

from firmware_py import constant

const = constant.const

OUTPUTS = const(6)  # outputs.COUNT; so many sums are taken one by one
# entries of the head
LOW_BITS = const(3)
PART_BITS = const(11)
HIGH_BITS = const(12)
SUMS = const(14)


def nested(c, d, own, steps, u, part, high, head, work, i, last, at, downs):
    """Add the program steps[i..last-1] to work: the outputs' sums from its beginning on, and depth 3's.

    The features are the inputs from OUTPUTS on. The words of the leaves begin at `at`; each output's runs are
    shifted down by its four bits of `downs`. Branches begin empty, and are left so.
    """
    v = h = 0  # the most used first: those behind the first sixteen are slower to reach
    n = head[SUMS]
    low_sum_shift = head[LOW_BITS] + head[HIGH_BITS] - head[PART_BITS]
    branch = 0
    while i < last:
        v = steps[i]
        to = n * (v >> 5 & 3)
        i += 1
        if v & 128:
            h = u[steps[i]]
            i += 1
            a0 = h >> 14
            b0 = h & 16383
            for j in range(to, to + n):
                v = work[j] + own[branch]
                work[j] = 0
                h = v >> 14
                # the product of the two low halves is below what is kept
                work[j - n] += a0 * h + (a0 * (v & 16383) + b0 * h >> 14)
                branch += 1
            continue
        end = i + (v & 31)
        if n != OUTPUTS:
            for j in range(n):
                a0 = 0
                b0 = 0
                v = at + j
                for k in range(i, end):
                    h = steps[k]
                    a0 += c[v] * part[h]
                    b0 += d[v] * high[h]
                    v += n
                work[to + j] += a0 + (b0 >> low_sum_shift) >> (downs >> 4 * j & 15)
            at += n * (end - i)
            i = end
            continue
        # all at once: an input is read once, and a look-up costs as much as a product
        a0 = a1 = a2 = a3 = a4 = a5 = 0
        b0 = b1 = b2 = b3 = b4 = b5 = 0
        while i < end:
            h = steps[i]
            v = part[h]
            h = high[h]
            i += 1
            a0 += c[at] * v
            b0 += d[at] * h
            at += 1
            a1 += c[at] * v
            b1 += d[at] * h
            at += 1
            a2 += c[at] * v
            b2 += d[at] * h
            at += 1
            a3 += c[at] * v
            b3 += d[at] * h
            at += 1
            a4 += c[at] * v
            b4 += d[at] * h
            at += 1
            a5 += c[at] * v
            b5 += d[at] * h
            at += 1
        work[to] += a0 + (b0 >> low_sum_shift) >> (downs & 15)
        work[to + 1] += a1 + (b1 >> low_sum_shift) >> (downs >> 4 & 15)
        work[to + 2] += a2 + (b2 >> low_sum_shift) >> (downs >> 8 & 15)
        work[to + 3] += a3 + (b3 >> low_sum_shift) >> (downs >> 12 & 15)
        work[to + 4] += a4 + (b4 >> low_sum_shift) >> (downs >> 16 & 15)
        work[to + 5] += a5 + (b5 >> low_sum_shift) >> (downs >> 20 & 15)


def dot_high(c, at, high, first, n):
    """One sum with high words alone, good to 1e-3 of the largest coefficient."""
    a = 0
    n += at
    while at < n:
        a += c[at] * high[first]
        at += 1
        first += 1
    return a

"""Where the bump is: a matched filter over places and widths. It finds the peak, it assumes none.

The map is a list of integers on a 1 mm grid, in any unit below 2^23.
"""

from firmware_py import fixed

_ln = fixed.ln
_exp = fixed.exp

WIDTHS_UM = (2200, 3300, 5000, 7500, 11000, 16000)
WORK = 256  # numbers of working space: two for each of up to 128 places


def centre_map(y, n, work):
    """y minus its mean into work[0..n), shifted to 11 bits and sign."""
    s = 0
    for i in range(n):
        s += y[i] >> 3
    m = s * 8 // n
    top = 1
    for i in range(n):
        v = y[i] - m
        if v < 0:
            v = -v
        if v > top:
            top = v
    sh = 0
    while top >= 2048:
        top >>= 1
        sh += 1
    for i in range(n):
        work[i] = (y[i] - m) >> sh


def bump_table(width_um, n, work):
    """exp(-d^2 / 2 width^2) in Q8 for d = 0, 1, ... mm into work[n..2n); returns how many are not zero."""
    reach = n
    for d in range(n):
        z = d * 4096000 // width_um
        if z > 14500:
            reach = d
            break
        work[n + d] = _exp(-(z * z >> 1), 16)
    return reach


def correlate(work, n, c, reach, sums):
    """The centred map against the table's bump at place c.

    sums: of their products, of the bump, and of its squares about its mean.
    """
    i = c - reach + 1
    if i < 0:
        i = 0
    e = c + reach
    if e > n:
        e = n
    num = 0
    k1 = 0
    k2 = 0
    while i < e:
        k = work[n + i - c] if i >= c else work[n + c - i]
        num += k * work[i]
        k1 += k
        k2 += k * k
        i += 1
    sums[0] = num
    sums[1] = k1
    sums[2] = k2 - k1 * k1 // n


def search(y, n, low, high, work, best, sums):
    """Best place and width of a positive bump with its middle in low..high (grid indices).

    best[0] becomes the index, best[1] the width in um; sums: space for three numbers. Returns 1, or 0 where
    nothing rises anywhere.
    """
    centre_map(y, n, work)
    found = 0
    top = 0
    for w in range(6):
        width = WIDTHS_UM[w]
        reach = bump_table(width, n, work)
        for c in range(low, high + 1):
            correlate(work, n, c, reach, sums)
            if sums[0] > 0 and sums[2] > 0:
                score = 2 * _ln(sums[0]) - _ln(sums[2])
                if not found or score > top:
                    found = 1
                    top = score
                    best[0] = c
                    best[1] = width
    return found

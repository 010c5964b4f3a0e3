"""A model image's sections as the evaluator's tables, and what they leave out since it can be worked out."""

from array import array

from firmware_py import evaluator


def middle(lo, hi):
    """Entries Y_MID and Y_SHIFT of an output whose predictions lie between lo and hi."""
    mid = (lo + hi) >> 1
    half = hi - mid
    shift = -28
    while half:
        half >>= 1
        shift += 1
    return mid, shift


def scaling(lo, hi, centre):
    """Entries SHIFT and FACTOR of a feature: what takes x - centre into +-1 in Q28."""
    half = max(hi - centre, centre - lo, 1)
    shift = 0
    while half << shift <= 1 << 27:
        shift += 1
    while half > 1 << 28 - shift:
        shift -= 1
    size = half << shift if shift >= 0 else half >> -shift
    # the factor has 16 bits; +-1 is missed by 2^-9, so that no product of two reaches 1
    return -shift, (1 << 28) * 16352 // size


def program(steps, n):
    """(leaves, branches, bytes) of the outputs' program at the beginning of `steps`; None if it is none.

    Every step must keep to the inputs and to three depths, every branch must be closed, and ln sigma's runs
    take every input once.
    """
    leaves = 0
    branches = 0
    deepest = 0  # branch that is not closed
    sigma = 0
    size = len(steps)
    i = 0
    while i < len(steps):
        head = steps[i]
        depth = head >> 5 & 3
        i += 1
        if head & 128:
            if depth == 0 or deepest > depth or sigma or i >= len(steps) or steps[i] >= n:
                return None
            deepest = depth - 1
            i += 1
            branches += 1
            continue
        head &= 31
        if head == 0 or i + head > len(steps):
            return None
        if depth == 3 and sigma == 0:
            size = i - 1
        elif depth < 3:
            if sigma:
                return None
            deepest = max(deepest, depth)
            leaves += head
        for k in range(i, i + head):
            if not (steps[k] == sigma if depth == 3 else 5 <= steps[k] < 5 + n):
                return None
            if depth == 3:
                sigma += 1
        i += head
    return None if deepest or sigma != 5 + n else (leaves, branches, size)


def numbers(raw, n, sizes):
    """n signed numbers of sizes[0], sizes[1], .. bits in turns, lowest bit first."""
    out = array("i", bytearray(4 * n))
    held = 0
    have = 0
    k = 0
    for i in range(n):
        bits = sizes[i % len(sizes)]
        sign = 1 << bits - 1
        while have < bits:
            held |= raw[k] << have
            have += 8
            k += 1
        out[i] = ((held & (2 * sign - 1)) ^ sign) - sign
        held >>= bits
        have -= bits
    return out


def pieces(whole, low, c, d, at):
    """Split numbers into high words and low words of `low` bits, into c and d from `at`."""
    half = 1 << low >> 1
    for v in whole:
        c[at] = v + half >> low
        d[at] = v - (c[at] << low)
        at += 1


def share(steps, size, whole, head, c, d, own):
    """The outputs' coefficients, which stand in the program's order: leaves to c and d, branches' to own."""
    k = 0
    leaf = 0
    branch = 0
    i = 0
    while i < size:
        n = steps[i]
        if n & 128:
            for j in range(5):
                own[branch] = whole[k] << head[11] - head[3] - (head[2] >> 4 * j & 15)
                branch += 1
                k += 1
            i += 2
        else:
            n &= 31
            pieces(whole[k : k + 5 * n], head[3], c, d, leaf)
            leaf += 5 * n
            k += 5 * n
            i += 1 + n


def head(raw):
    """The evaluator's head; the numbers of limits, of terms and of steps are seen from their sections."""
    out = array("i", bytearray(4 * evaluator.HEAD))
    numbers = array("i", raw[:16])
    for i in range(3):
        out[5 + i] = numbers[i]
    out[2] = numbers[3]
    out[8] = raw[16] | raw[17] << 8
    out[10] = raw[18] | raw[19] << 8
    out[0] = raw[20]
    out[3] = raw[21]
    out[9] = raw[22]
    out[11] = raw[23]
    out[12] = raw[24]
    return out


def feats(raw):
    """The feature table from what the image keeps of it: clip, centre and box."""
    kept = array("i", raw)
    n = len(kept) // 5
    feats = array("i", bytearray(28 * n))
    for i in range(n):
        lo, hi, centre = kept[5 * i], kept[5 * i + 1], kept[5 * i + 2]
        feats[7 * i] = lo
        feats[7 * i + 1] = hi
        feats[7 * i + 2] = centre
        feats[7 * i + 3], feats[7 * i + 4] = scaling(lo, hi, centre)
        feats[7 * i + 5] = kept[5 * i + 3]
        feats[7 * i + 6] = kept[5 * i + 4]
    return feats


def rows(raw):
    """Intercepts and shifts, kept apart in the image, in turns."""
    n = len(raw) // 5
    rows = array("i", bytearray(8 * n))
    intercepts = array("i", raw[: 4 * n])
    shifts = array("b", raw[4 * n :])
    for i in range(n):
        rows[2 * i] = intercepts[i]
        rows[2 * i + 1] = shifts[i]
    return rows


def outs(raw, links):
    """The output table from what the image keeps of it: its ends, the quantiles' logarithms, the range."""
    kept = array("i", raw)
    outs = array("i", bytearray(4 * evaluator.OUTPUT_ROW * evaluator.OUTPUTS))
    for j in range(evaluator.OUTPUTS):
        at = 9 * j
        lo, hi = kept[6 * j], kept[6 * j + 1]
        outs[at] = links >> j & 1
        outs[at + 1] = lo
        outs[at + 2] = hi
        outs[at + 3], outs[at + 4] = middle(lo, hi)
        for k in range(4):
            outs[at + 5 + k] = kept[6 * j + 2 + k]
    return outs

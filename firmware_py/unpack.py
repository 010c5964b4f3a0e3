"""A model image's sections as the evaluator's tables, and what they leave out since it can be worked out."""

from array import array

from firmware_py import constant, evaluator

const = constant.const

# where each of the numbers stands in its section: first HARD_BELOW, FORCE_LO, FORCE_HI
_DOWNS = const(3)  # and DOWNS, of 32 bits each
_LEVEL = const(16)  # two bytes each
_MARGIN = const(18)
_N_FEATURES = const(20)  # one byte each
_LOW_BITS = const(21)
_LINKS = const(22)
_PART_BITS = const(23)
_HIGH_BITS = const(24)
NUMBERS_HEAD = 25  # bytes of the numbers before the sizes of the words
NUMBERS_BYTES = NUMBERS_HEAD + 2 * evaluator.OUTPUTS  # and a byte an output behind, where one has a scale
ROW_BYTES = 5  # an intercept and its shift
_PIECE = const(1024)  # bytes read at a time
# what the image keeps of a feature's row and of an output's; the rest is worked out
FEATURE_KEPT = (
    evaluator.CLIP_LO,
    evaluator.CLIP_HI,
    evaluator.CENTRE,
    evaluator.BOX_LO,
    evaluator.BOX_HI,
)
OUTPUT_KEPT = (
    evaluator.Y_LO,
    evaluator.Y_HI,
    evaluator.LN_Q_SOFT,
    evaluator.LN_Q_HARD,
    evaluator.RANGE_LO,
    evaluator.RANGE_HI,
)


def middle(lo, hi):
    """Entries Y_MID and Y_SHIFT of an output whose predictions lie between lo and hi."""
    mid = (lo + hi) >> 1
    half = max(hi - mid, 0)
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
    first = evaluator.OUTPUTS
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
            if not (steps[k] == sigma if depth == 3 else first <= steps[k] < first + n):
                return None
            if depth == 3:
                sigma += 1
        i += head
    return None if deepest or sigma != first + n else (leaves, branches, size)


class Numbers:
    """Signed numbers of sizes[0], sizes[1], .. bits in turns, lowest bit first, from `at` on.

    read(offset, n) gives their bytes. They are read and taken some at a time: a board may have no block for
    all of a model's at once.
    """

    def __init__(self, read, at, sizes):
        self._read = read
        self._at = at
        self._piece = b""
        self._next = 0
        self._sizes = sizes
        self._turn = 0
        self._held = 0
        self._have = 0

    def take(self, n):
        """The next n of them."""
        out = array("i", bytearray(4 * n))
        held = self._held
        have = self._have
        piece = self._piece
        end = len(piece)
        k = self._next
        sizes = self._sizes
        turns = len(sizes)
        turn = self._turn
        for i in range(n):
            bits = sizes[turn]
            turn += 1
            if turn == turns:
                turn = 0
            sign = 1 << bits - 1
            while have < bits:
                if k == end:
                    piece = self._read(self._at, _PIECE)
                    end = len(piece)
                    self._at += end
                    k = 0
                held |= piece[k] << have
                have += 8
                k += 1
            out[i] = ((held & (2 * sign - 1)) ^ sign) - sign
            held >>= bits
            have -= bits
        self._turn = turn
        self._held = held
        self._have = have
        self._piece = piece
        self._next = k
        return out


def pieces(whole, low, c, d, at):
    """Split numbers into high words and low words of `low` bits, into c and d from `at`; ValueError if one is
    too large.
    """
    half = 1 << low >> 1
    for v in whole:
        high = v + half >> low
        if high > 32767:
            raise ValueError
        c[at] = high
        d[at] = v - (high << low)
        at += 1


def share(steps, size, numbers, head, c, d, own):
    """The outputs' coefficients, which stand in the program's order: leaves to c and d, branches' to own.

    Of the outputs that the image has, the first head[SUMS] are kept.
    """
    leaf = 0
    branch = 0
    i = 0
    kept = head[evaluator.SUMS]
    while i < size:
        n = steps[i]
        if n & 128:
            whole = numbers.take(evaluator.OUTPUTS)
            for j in range(kept):
                down = head[evaluator.DOWNS] >> 4 * j & 15
                own[branch] = whole[j] << head[evaluator.PART_BITS] - head[evaluator.LOW_BITS] - down
                branch += 1
            i += 2
        else:
            n &= 31
            whole = numbers.take(evaluator.OUTPUTS * n)
            if kept < evaluator.OUTPUTS:
                whole = [whole[k] for k in range(len(whole)) if k % evaluator.OUTPUTS < kept]
            pieces(whole, head[evaluator.LOW_BITS], c, d, leaf)
            leaf += kept * n
            i += 1 + n


def head(raw):
    """The evaluator's head; the numbers of limits, of terms and of steps are seen from their sections."""
    out = array("i", bytearray(4 * evaluator.HEAD))
    numbers = array("i", raw[:_LEVEL])
    for i in range(_DOWNS):
        out[evaluator.HARD_BELOW + i] = numbers[i]
    out[evaluator.DOWNS] = numbers[_DOWNS]
    out[evaluator.LEVEL_PERMILLE] = raw[_LEVEL] | raw[_LEVEL + 1] << 8
    out[evaluator.MARGIN] = raw[_MARGIN] | raw[_MARGIN + 1] << 8
    out[evaluator.N_FEATURES] = raw[_N_FEATURES]
    out[evaluator.LOW_BITS] = raw[_LOW_BITS]
    out[evaluator.LINKS] = raw[_LINKS]
    out[evaluator.PART_BITS] = raw[_PART_BITS]
    out[evaluator.HIGH_BITS] = raw[_HIGH_BITS]
    return out


def links(raw):
    """The link of each output (scales.value), from the same bytes as `head`."""
    if len(raw) > NUMBERS_BYTES:
        return raw[NUMBERS_BYTES:]
    return bytes([raw[_LINKS] >> j & 1 for j in range(evaluator.OUTPUTS)])


def spread(kept, where, row):
    """A table of rows of `row` entries, with the kept ones at the places `where` of each."""
    n = len(where)
    out = array("i", bytearray(4 * row * (len(kept) // n)))
    for i in range(len(kept)):
        out[row * (i // n) + where[i % n]] = kept[i]
    return out


def feats(raw):
    """The feature table from what the image keeps of it: clip, centre and box."""
    feats = spread(array("i", raw), FEATURE_KEPT, evaluator.FEATURE_ROW)
    for at in range(0, len(feats), evaluator.FEATURE_ROW):
        lo, hi = feats[at + evaluator.CLIP_LO], feats[at + evaluator.CLIP_HI]
        feats[at + evaluator.SHIFT], feats[at + evaluator.FACTOR] = scaling(
            lo, hi, feats[at + evaluator.CENTRE]
        )
    return feats


def rows(raw):
    """Intercepts and shifts, kept apart in the image, in turns."""
    n = len(raw) // ROW_BYTES
    rows = array("i", bytearray(8 * n))
    intercepts = array("i", raw[: 4 * n])
    shifts = array("b", raw[4 * n :])
    for i in range(n):
        rows[2 * i] = intercepts[i]
        rows[2 * i + 1] = shifts[i]
    return rows


def outs(raw, links):
    """The output table from what the image keeps of it: its ends, the quantiles' logarithms, the range."""
    outs = spread(array("i", raw), OUTPUT_KEPT, evaluator.OUTPUT_ROW)
    for j in range(evaluator.OUTPUTS):
        at = evaluator.OUTPUT_ROW * j
        outs[at + evaluator.LINK] = links[j]
        outs[at + evaluator.Y_MID], outs[at + evaluator.Y_SHIFT] = middle(
            outs[at + evaluator.Y_LO], outs[at + evaluator.Y_HI]
        )
    return outs

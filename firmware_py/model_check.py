"""Every number of a model image, looked at before one of them is used; the probe and the host call the same.

A signature says who made an image, not that it makes sense: an output whose ends were exchanged once kept a
loop going for ever. What is let through ends, and stays in its arrays; that it cannot overflow either is the
exporter's proof, that it computes what was meant the image's own vectors.
"""

from array import array

from firmware_py import evaluator, forcemap, status, unpack

MOST = (1 << 30) - 1  # of any number that is only compared
WIDEST = 1 << 29  # of a feature or a prediction, Q24: 32
FEATURES = 24  # no model has more
MOST_VALUES = 3  # of a first stage, as stage.MOST
INFO_BYTES = 2048
MOST_LINK = 26
DISTANCE_BITS = 12
FIRST_ID = 240  # of the first value of a first stage (stage.py)


def within(values, first, step, low, high):
    """Do all of values[first::step] lie between low and high?"""
    for i in range(first, len(values), step):
        if not low <= values[i] <= high:
            return False
    return True


def ascending(values, first, second, step):
    """Is each of values[first::step] at most the one `second` places from the row's beginning?"""
    for i in range(0, len(values), step):
        if values[i + first] > values[i + second]:
            return False
    return True


def places(ids, feature_count):
    """Where features of these ids stand: the values of a first stage are behind the firmware's own."""
    return bytes([i if i < feature_count else i - FIRST_ID + feature_count for i in ids])


def features(numbers):
    """How many features an image's first section says that it has; 0 where that is impossible."""
    if len(numbers) not in (unpack.NUMBERS_BYTES, unpack.NUMBERS_BYTES + evaluator.OUTPUTS):
        return 0
    n = unpack.head(numbers)[evaluator.N_FEATURES]
    return n if n <= FEATURES else 0


def check(parts, counts, feature_count, values=0):
    """OK, or what is wrong with an image's sections (parts: number of a section -> its bytes).

    Of the words, the largest, there is only the length. counts: of the program (`unpack.program`); values:
    how many more features a first stage gives.

    BAD_LENGTH where sections do not fit each other, MISSING_FEATURE, BAD_MODEL where a number is impossible.
    """
    numbers, ids, feats, _, words, rows, outs, limits, info, force_map = parts[1:11]
    n = features(numbers)
    if n == 0:
        return status.BAD_LENGTH
    head = unpack.head(numbers)
    sizes = numbers[unpack.NUMBERS_HEAD : unpack.NUMBERS_BYTES]
    if max(unpack.links(numbers)) > MOST_LINK:
        return status.BAD_MODEL
    if (
        len(ids) != n
        or len(feats) != 4 * len(unpack.FEATURE_KEPT) * n
        or len(rows) != unpack.ROW_BYTES * (2 * evaluator.OUTPUTS + n)
        or len(outs) != 4 * len(unpack.OUTPUT_KEPT) * evaluator.OUTPUTS
        or len(limits) % 12
    ):
        return status.BAD_LENGTH
    code = check_head(head, sizes)
    if code == status.OK:
        code = check_features(ids, array("i", feats), array("i", limits), feature_count, values)
    if code == status.OK:
        code = _check_sums(rows, array("i", outs))
    if code != status.OK:
        return code
    leaves, branches, _ = counts
    outputs = evaluator.OUTPUTS
    size = ((leaves + branches) * sum(sizes[:outputs]) + 7) // 8 + (
        (outputs + n) * sum(sizes[outputs:]) + 7
    ) // 8
    if words != size + (n * (n + 1) // 2 * DISTANCE_BITS + 7) // 8 or len(info) > INFO_BYTES:
        return status.BAD_LENGTH
    for byte in info:
        if byte != 10 and not 32 <= byte <= 126:
            return status.BAD_MODEL
    if force_map and forcemap.load(force_map) is None:
        return status.BAD_MODEL
    return status.OK


def check_head(head, sizes):
    """OK, or BAD_MODEL where a number that evaluator.py has in its head is impossible."""
    low = head[evaluator.LOW_BITS]
    part = head[evaluator.PART_BITS]
    high = head[evaluator.HIGH_BITS]
    if (
        not 13 <= high <= 15
        or not 1 <= low <= 14
        or not 18 <= part <= min(low + high, 22)
        or not 1 < min(sizes) <= max(sizes) <= min(low + 16, 30)
        or head[evaluator.LEVEL_PERMILLE] > 1000
        or head[evaluator.MARGIN] > 2047  # times 2^19, a width
        or head[evaluator.LINKS] >= 1 << evaluator.OUTPUTS
        or not 0 <= head[evaluator.DOWNS] < 1 << 4 * (evaluator.OUTPUTS + 1)
        or not within(head, evaluator.HARD_BELOW, 1, -MOST, MOST)
        or head[evaluator.FORCE_LO] > head[evaluator.FORCE_HI]
    ):
        return status.BAD_MODEL
    for j in range(evaluator.OUTPUTS):
        # a branch's coefficient is shifted up to the scale of its sum
        if (head[evaluator.DOWNS] >> 4 * j & 15) > part - low:
            return status.BAD_MODEL
    return status.OK


def check_features(ids, feats, limits, feature_count, values=0):
    """OK, or what is wrong with features' ids and rows, and with the lump rule's limits."""
    row = len(unpack.FEATURE_KEPT)
    for i in ids:
        if i >= feature_count and not FIRST_ID <= i < FIRST_ID + values:
            return status.MISSING_FEATURE
    if not within(limits, 0, 3, 0, feature_count - 1):
        return status.MISSING_FEATURE
    if (
        not within(feats, 0, 1, -MOST, MOST)
        or not ascending(feats, 0, 1, row)  # clip
        or not ascending(feats, 0, 2, row)  # which holds the centre
        or not ascending(feats, 2, 1, row)
        or not ascending(feats, 3, 4, row)  # the domain's box
    ):
        return status.BAD_MODEL
    for i in range(0, len(feats), row):
        if feats[i] < -WIDEST or feats[i + 1] > WIDEST:
            return status.BAD_MODEL
    if not within(limits, 1, 3, -MOST, MOST) or not within(limits, 2, 3, -MOST, MOST):
        return status.BAD_MODEL
    return status.OK if ascending(limits, 1, 2, 3) else status.BAD_MODEL


def _check_sums(rows, outs):
    n = len(rows) // unpack.ROW_BYTES
    row = len(unpack.OUTPUT_KEPT)
    if (
        not within(array("i", rows[: 4 * n]), 0, 1, -MOST, MOST)
        or not within(array("b", rows[4 * n :]), 0, 1, -28, 30)
        or not within(outs, 0, 1, -WIDEST, WIDEST)
        or not ascending(outs, 0, 1, row)  # where predictions are held
        or not ascending(outs, 4, 5, row)  # what the model is for
    ):
        return status.BAD_MODEL
    return status.OK

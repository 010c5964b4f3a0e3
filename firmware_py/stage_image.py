"""How a first stage, or checks, lie in a model's image, every number looked at; docs/model-image.md.

A board has no room for this at other times than a model's loading (memory.forget).
"""

from array import array

from firmware_py import constant, evaluator, model_check, stage, status, unpack

const = constant.const

# the section's head
_FEATURES = const(0)
_VALUES = const(1)
_LOW_BITS = const(2)
_PART_BITS = const(3)
_HIGH_BITS = const(4)
_SIZES = const(5)  # of the words, one for each sum
_OF_PRESS = const(11)  # bit j: value j is of the press
_STEPS = const(12)  # bytes of the program
_DOWNS = const(16)
_HEAD = const(20)
_KEPT = const(20)  # bytes of a feature's row


def places(raw):
    """Where ids, features, ends, rows, steps and words begin; None where there is not even a head."""
    if len(raw) < _HEAD:
        return None
    n = raw[_FEATURES]
    at = [_HEAD]
    rows = unpack.ROW_BYTES * evaluator.OUTPUTS  # the intercepts and their shifts
    for size in (n, _KEPT * n, 4 * stage.ENDS * stage.MOST, rows, raw[_STEPS] | raw[_STEPS + 1] << 8):
        at.append(at[-1] + (size + 3 & -4))
    return at


def load(raw, feature_count, values=0):
    """(status, stage) of the section's bytes; the stage is None unless OK.

    values: of a stage before this one, which may be asked for like features.
    """
    at = places(raw)
    if at is None or len(raw) < at[-1]:
        return status.BAD_LENGTH, None
    n = raw[_FEATURES]
    count = raw[_VALUES]
    outputs = evaluator.OUTPUTS
    sizes = raw[_SIZES : _SIZES + outputs]
    head = array("i", bytearray(4 * evaluator.HEAD))
    head[evaluator.N_FEATURES] = n
    head[evaluator.LOW_BITS] = raw[_LOW_BITS]
    head[evaluator.PART_BITS] = raw[_PART_BITS]
    head[evaluator.HIGH_BITS] = raw[_HIGH_BITS]
    head[evaluator.DOWNS] = array("i", raw[_DOWNS:_HEAD])[0]
    if not 0 < n <= model_check.FEATURES or not 0 < count <= stage.MOST:
        return status.BAD_LENGTH, None
    ids = raw[at[0] : at[0] + n]
    feats = raw[at[1] : at[2]]
    ends = array("i", raw[at[2] : at[3]])
    code = model_check.check_head(head, sizes)
    if code == status.OK:
        code = model_check.check_features(ids, array("i", feats), array("i"), feature_count, values)
    if code == status.OK:
        code = _check_sums(raw[at[3] : at[4]], ends)
    if code != status.OK:
        return code, None
    steps = raw[at[4] : at[4] + (raw[_STEPS] | raw[_STEPS + 1] << 8)]
    # `program` looks at ln sigma's runs as well; here there are none
    sigma = outputs + n
    counts = unpack.program(steps + bytes([96 + sigma]) + bytes(range(sigma)), n)
    if counts is None or counts[2] != len(steps):
        return status.BAD_LENGTH, None
    leaves, branches, _ = counts
    size = ((leaves + branches) * sum(sizes) + 7) // 8
    test = at[5] + (size + 3 & -4)
    end = test + (n + 3 & -4) + 4 * count
    if len(raw) != end and len(raw) != end + 4 * stage.REFERS:
        return status.BAD_LENGTH, None
    refers = array("i", raw[end:])
    if refers and not (count == stage.MOST and _referring(refers)):
        return status.BAD_MODEL, None
    head[evaluator.LEAVES] = leaves
    head[evaluator.STEPS] = len(steps)
    # the image has as many sums as a model has outputs; those that the stage does not need are left there
    head[evaluator.SUMS] = count
    c = array("h", bytearray(2 * count * leaves))
    d = array("h", bytearray(2 * count * leaves))
    own = array("i", bytearray(4 * count * branches))
    numbers = unpack.Numbers(lambda offset, n: raw[offset : offset + n], at[5], sizes)
    unpack.share(steps, len(steps), numbers, head, c, d, own)
    rows = unpack.rows(raw[at[3] : at[3] + unpack.ROW_BYTES * outputs])[: evaluator.ROW * count]
    ids = model_check.places(ids, feature_count)
    feature_count += values
    found = stage.Stage(
        ids, unpack.feats(feats), steps, c, d, own, rows, ends, head, count, feature_count, refers,
        raw[_OF_PRESS],
    )  # fmt: skip
    return (status.OK if _same(found, raw, test) else status.SELF_TEST), found


def _check_sums(rows, ends):
    n = evaluator.OUTPUTS
    if (
        not model_check.within(array("i", rows[: 4 * n]), 0, 1, -model_check.MOST, model_check.MOST)
        or not model_check.within(array("b", rows[4 * n :]), 0, 1, -28, 30)
        or not model_check.within(ends, 0, 1, -model_check.WIDEST, model_check.WIDEST)
        or not model_check.ascending(ends, 0, 1, stage.ENDS)
    ):
        return status.BAD_MODEL
    return status.OK


def _referring(refers):
    """Whether these numbers can say how a reference joins: nothing leaves +-2^30 with them."""
    return (
        model_check.within(refers[: stage.TRIANGLE], 0, 1, 0, 1 << 14)
        and model_check.within(refers[stage.TRIANGLE : stage.LIMIT], 0, 1, -32767, 32767)
        and 0 < refers[stage.LIMIT] <= 1 << 29
    )


def _same(found, raw, at):
    """Whether the vector that travels in the section gives the values that stand beside it."""
    from firmware_py import model_image

    x = array("i", bytearray(4 * found.feature_count))
    n = len(found.ids)
    for i in range(n):
        x[found.ids[i]] = model_image.place(found.feats, i, raw[at + i])
    at += n + 3 & -4
    stated = array("i", raw[at : at + 4 * found.count])
    got = found.extend(x)
    for j in range(found.count):
        if got[found.feature_count + j] != stated[j]:
            return False
    return True

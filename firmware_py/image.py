"""The model image: how a model lies in the probe's store, and how it becomes tables.

Little endian. Head of 104 bytes, at its end the lengths of the sections (u16 each, 0 for one that is
left out); the sections in order, each padded to a multiple of four; the signature over all of it.
docs/model-image.md has it in full. Everything here believes what it reads: the caller verifies the
signature first (lms.py).
"""

from array import array

from firmware_py import evaluator, status

PROBE = b"palpate-16x26"
MAGIC = b"PALP"
VERSION = 3
HEAD_SIZE = 104
ROLLBACK = 1

# sections
NUMBERS = 1  # evaluator's head
IDS = 2
FEATURES = 3
STEPS = 4  # without the first ones where these are all pairs of features in order
WORDS = 5  # coefficients, high and low word in one; then the distance's
GROUPS = 6  # of terms, each group's end
ROWS = 7
OUTPUTS = 8
LIMITS = 9
INFO = 10  # text: names of the features, of the outputs, unit of the integers
FORCE_MAP = 11
SELF_TEST = 12
LAST = 12

TESTED = 17  # integers of an estimate that a self-test vector fixes
DISTANCE_BITS = 12


def u32(b, at):
    """Little-endian number of four bytes."""
    return b[at] | b[at + 1] << 8 | b[at + 2] << 16 | b[at + 3] << 24


class Header:
    """What stands in front of an image's sections; `code` says what is wrong with it, if anything is."""

    def __init__(self, read, body, probe=PROBE):
        self.code = status.OK
        b = read(0, HEAD_SIZE)
        if len(b) < HEAD_SIZE or b[:4] != MAGIC:
            self.code = status.BAD_MAGIC
            return
        if b[4] != VERSION:
            self.code = status.BAD_VERSION
            return
        self.kind = b[5]
        self.features_version = b[6]
        self.rollback = b[7] & ROLLBACK
        self.counter = u32(b, 12)
        self.replaces = u32(b, 16)
        self.probe = bytes(b[24:40])
        self.model_id = bytes(b[40:48])
        self.training = bytes(b[48:80])
        if u32(b, 8) != body:
            self.code = status.BAD_LENGTH
            return
        if self.probe != probe + bytes(16 - len(probe)):
            self.code = status.BAD_PROBE
            return
        self.places = {}
        at = HEAD_SIZE
        for tag in range(1, LAST + 1):
            n = b[78 + 2 * tag] | b[79 + 2 * tag] << 8
            self.places[tag] = (at, n)
            at += n + 3 & -4
        if at != body:
            self.code = status.BAD_LENGTH

    def section(self, read, tag):
        """Bytes of a section; empty if the image has none of that tag."""
        at, n = self.places[tag]
        return bytes(read(at, n)) if n else b""


class Model:
    """A model ready to evaluate."""

    def __init__(self, header, tables, force_map):
        self.header = header
        self.tables = tables
        self.force_map = force_map
        self.model_id = header.model_id
        self.kind = header.kind
        self.evaluate = tables.evaluate


def all_pairs(n):
    """The steps of all products of two out of n features, in order."""
    steps = bytearray(n * (n + 1))
    at = 0
    for i in range(n):
        for j in range(i, n):
            steps[at] = i
            steps[at + 1] = j
            at += 2
    return bytes(steps)


def _words(c, d, at, raw, n, bits, low):
    """Unpack n signed numbers of `bits` bits each, lowest bit first, into c and d from `at`."""
    held = 0
    have = 0
    k = 0
    sign = 1 << bits - 1
    half = 1 << low >> 1
    for _ in range(n):
        while have < bits:
            held |= raw[k] << have
            have += 8
            k += 1
        v = ((held & (2 * sign - 1)) ^ sign) - sign
        c[at] = v + half >> low
        if low:
            d[at] = v - (c[at] << low)
        held >>= bits
        have -= bits
        at += 1


def _head(raw, groups):
    """The evaluator's head; how many limits there are is seen from their section."""
    head = array("i", bytearray(4 * evaluator.HEAD))
    numbers = array("i", raw[:12])
    for i in range(3):
        head[5 + i] = numbers[i]
    head[1] = raw[12] | raw[13] << 8
    head[2] = raw[14] | raw[15] << 8
    head[8] = raw[16] | raw[17] << 8
    head[10] = raw[18] | raw[19] << 8
    head[0] = raw[20]
    head[3] = raw[21]
    head[9] = raw[22]
    head[11] = raw[23]
    head[12] = 1 if raw[23] == 13 else 0
    head[13] = raw[24]
    head[14] = len(groups) // 2
    for i in range(0, len(groups), 2):
        head.append(5 + (groups[i] | groups[i + 1] << 8))
    return head


def _feats(raw):
    """The feature table from what the image keeps of it: clip, centre and box."""
    kept = array("i", raw)
    n = len(kept) // 5
    feats = array("i", bytearray(28 * n))
    for i in range(n):
        lo, hi, centre = kept[5 * i], kept[5 * i + 1], kept[5 * i + 2]
        feats[7 * i] = lo
        feats[7 * i + 1] = hi
        feats[7 * i + 2] = centre
        feats[7 * i + 3], feats[7 * i + 4] = evaluator.scaling(lo, hi, centre)
        feats[7 * i + 5] = kept[5 * i + 3]
        feats[7 * i + 6] = kept[5 * i + 4]
    return feats


def _rows(raw):
    """Intercepts and shifts, kept apart in the image, in turns."""
    n = len(raw) // 5
    rows = array("i", bytearray(8 * n))
    intercepts = array("i", raw[: 4 * n])
    shifts = array("b", raw[4 * n :])
    for i in range(n):
        rows[2 * i] = intercepts[i]
        rows[2 * i + 1] = shifts[i]
    return rows


def _outs(raw, links):
    """The output table from what the image keeps of it: its ends, the quantiles' logarithms, the range."""
    kept = array("i", raw)
    outs = array("i", bytearray(4 * evaluator.OUTPUT_ROW * evaluator.OUTPUTS))
    for j in range(evaluator.OUTPUTS):
        at = 9 * j
        lo, hi = kept[6 * j], kept[6 * j + 1]
        outs[at] = links >> j & 1
        outs[at + 1] = lo
        outs[at + 2] = hi
        outs[at + 3], outs[at + 4] = evaluator.middle(lo, hi)
        for k in range(4):
            outs[at + 5 + k] = kept[6 * j + 2 + k]
    return outs


def _fits(tables, feature_count):
    """Do the tables' lengths agree with each other, and do the features exist? A status."""
    n = tables.head[0]
    terms = tables.head[1]
    sigma = tables.head[2]
    fine = 5 * terms + 5 * (5 + sigma)
    if (
        not 0 < n <= terms
        or not 0 <= sigma <= terms
        or len(tables.ids) != n
        or len(tables.feats) != 7 * n
        or len(tables.steps) != 2 * (terms - n)
        or len(tables.c) != fine + n * (n + 1) // 2
        or len(tables.d) != fine
        or len(tables.rows) != 2 * (10 + n)
        or len(tables.limits) != 3 * tables.head[4]
        or tables.head[len(tables.head) - 1] != 5 + terms
    ):
        return status.BAD_LENGTH
    for i in range(0, len(tables.steps), 2):
        if tables.steps[i] >= n + i // 2 or tables.steps[i + 1] >= n:
            return status.BAD_VALUE
    for i in tables.ids:
        if i >= feature_count:
            return status.MISSING_FEATURE
    for i in range(0, len(tables.limits), 3):
        if not 0 <= tables.limits[i] < feature_count:
            return status.MISSING_FEATURE
    return status.OK


def load(read, body, features_version, feature_count, probe=PROBE):
    """(status, model) of an image of `body` bytes, signature not counted; the model is None unless OK.

    read(offset, n) gives bytes; features_version and feature_count say what this firmware computes.
    """
    h = Header(read, body, probe)
    if h.code != status.OK:
        return h.code, None
    if h.features_version != features_version:
        return status.BAD_VERSION, None
    head = h.section(read, NUMBERS)
    groups = h.section(read, GROUPS)
    if len(head) != 27 or not groups or len(groups) % 2:
        return status.BAD_LENGTH, None
    sizes = head[25:]
    head = _head(head, groups)
    limits = array("i", h.section(read, LIMITS))
    head[4] = len(limits) // 3
    outs = h.section(read, OUTPUTS)
    rows = h.section(read, ROWS)
    if not 0 < head[1] < 1000 or len(outs) != 24 * evaluator.OUTPUTS or len(rows) % 5:
        return status.BAD_LENGTH, None
    n = head[0]
    fine = 5 * (head[1] + 5 + head[2])
    coarse = n * (n + 1) // 2
    words = h.section(read, WORDS)
    first = 5 * head[1]
    sigma = (first * sizes[0] + 7) // 8
    start = sigma + ((fine - first) * sizes[1] + 7) // 8
    steps = h.section(read, STEPS)
    if (
        not 1 <= head[3] <= 12
        or not 13 <= head[11] <= min(20, 13 + head[3])
        or not head[3] < min(sizes) <= max(sizes) <= head[3] + 16
        or len(words) != start + (coarse * DISTANCE_BITS + 7) // 8
    ):
        return status.BAD_LENGTH, None
    c = array("h", bytearray(2 * (fine + coarse)))
    d = array("h", bytearray(2 * fine))
    _words(c, d, 0, words, first, sizes[0], head[3])
    _words(c, d, first, words[sigma:], fine - first, sizes[1], head[3])
    _words(c, d, fine, words[start:], coarse, DISTANCE_BITS, 0)
    if len(steps) < 2 * (head[1] - n):
        steps = all_pairs(n) + steps
    tables = evaluator.Tables(
        h.section(read, IDS),
        _feats(h.section(read, FEATURES)),
        steps,
        c,
        d,
        _rows(rows),
        _outs(outs, head[9]),
        limits,
        head,
    )
    code = _fits(tables, feature_count)
    if code != status.OK:
        return code, None
    return status.OK, Model(h, tables, h.section(read, FORCE_MAP) or None)


def self_test(model, read, feature_count):
    """Run the vectors that travel in the image; OK if every integer comes out as stated, else SELF_TEST.

    Section: count, number of extra features, their ids; padding; their values; then for each vector one byte
    a feature (how far into its clip box, in 1/256) and, padded, the integers of its estimate.
    """
    raw = model.header.section(read, SELF_TEST)
    t = model.tables
    n = len(t.ids)
    if len(raw) < 4:
        return status.SELF_TEST
    count = raw[0]
    extra = raw[1]
    at = 2 + extra + 3 & -4
    inputs = at + 4 * extra
    stated = inputs + count * n + 3 & -4
    if not count or len(raw) != stated + 4 * count * TESTED:
        return status.SELF_TEST
    x = array("i", bytearray(4 * feature_count))
    values = array("i", raw[at:inputs])
    for i in range(extra):
        if raw[2 + i] >= feature_count:
            return status.SELF_TEST
        x[raw[2 + i]] = values[i]
    out = array("i", bytearray(4 * evaluator.OUT_SIZE))
    values = array("i", raw[stated:])
    for k in range(count):
        for i in range(n):
            x[t.ids[i]] = place(t.feats, i, raw[inputs + k * n + i])
        model.evaluate(x, out)
        for i in range(TESTED):
            if out[i] != values[k * TESTED + i]:
                return status.SELF_TEST
    return status.OK


def place(feats, i, byte):
    """Feature i of a self-test vector."""
    lo = feats[7 * i]
    return lo + (feats[7 * i + 1] - lo >> 8) * byte

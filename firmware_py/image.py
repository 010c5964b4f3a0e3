"""The model image: how a model lies in the probe's store, and how it becomes tables.

Little endian. Head of 104 bytes, at its end the lengths of the sections (u16 each, 0 for one that is
left out); the sections in order, each padded to a multiple of four; the signature over all of it.
docs/model-image.md has it in full. Everything here believes what it reads: the caller verifies the
signature first (lms.py).
"""

from array import array

from firmware_py import evaluator, status, unpack

PROBE = b"palpate-16x26"
MAGIC = b"PALP"
VERSION = 4
HEAD_SIZE = 104
ROLLBACK = 1

# sections
NUMBERS = 1  # evaluator's head
IDS = 2
FEATURES = 3
STEPS = 4  # the polynomials' program (polynomial.py), then ln sigma's runs, at depth 3
WORDS = 5  # coefficients, high and low word in one; then the distance's
ROWS = 6
OUTPUTS = 7
LIMITS = 8
INFO = 9  # text: names of the features, of the outputs, unit of the integers
FORCE_MAP = 10
SELF_TEST = 11
LAST = 11

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


def _fits(tables, feature_count):
    """Do the tables' lengths agree with each other, and do the features exist? A status."""
    n = tables.head[0]
    if (
        not 0 < n <= 24
        or len(tables.ids) != n
        or len(tables.feats) != 7 * n
        or len(tables.rows) != 2 * (10 + n)
        or len(tables.limits) != 3 * tables.head[4]
    ):
        return status.BAD_LENGTH
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
    if len(head) != 35:
        return status.BAD_LENGTH, None
    sizes = head[25:]
    head = unpack.head(head)
    limits = array("i", h.section(read, LIMITS))
    head[4] = len(limits) // 3
    outs = h.section(read, OUTPUTS)
    rows = h.section(read, ROWS)
    n = head[0]
    steps = h.section(read, STEPS)
    counts = unpack.program(steps, n)
    if counts is None:
        return status.BAD_LENGTH, None
    head[1], branches, head[13] = counts
    low = head[3]
    words = h.section(read, WORDS)
    terms = head[1] + branches
    two = 5 * (head[1] + 5 + n)
    coarse = n * (n + 1) // 2
    sigma = (terms * sum(sizes[:5]) + 7) // 8
    start = sigma + ((5 + n) * sum(sizes[5:]) + 7) // 8
    if (
        len(outs) != 24 * evaluator.OUTPUTS
        or len(rows) % 5
        or not 13 <= head[12] <= 15
        or not 1 <= low <= 14
        or not 18 <= head[11] <= low + head[12]
        or not 1 < min(sizes) <= max(sizes) <= min(low + 16, 30)
        or len(words) != start + (coarse * DISTANCE_BITS + 7) // 8
    ):
        return status.BAD_LENGTH, None
    c = array("h", bytearray(2 * (two + coarse)))
    d = array("h", bytearray(2 * two))
    own = array("i", bytearray(20 * branches))
    unpack.share(steps, head[13], unpack.numbers(words, 5 * terms, sizes[:5]), head, c, d, own)
    unpack.pieces(unpack.numbers(words[sigma:], 5 * (5 + n), sizes[5:]), low, c, d, 5 * head[1])
    for k, v in enumerate(unpack.numbers(words[start:], coarse, (DISTANCE_BITS,))):
        c[two + k] = v
    tables = evaluator.Tables(
        h.section(read, IDS),
        unpack.feats(h.section(read, FEATURES)),
        steps,
        c,
        d,
        own,
        unpack.rows(rows),
        unpack.outs(outs, head[9]),
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

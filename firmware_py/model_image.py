"""The model image: how a model lies in the probe's store, and how it becomes tables.

Little endian. Head of 104 bytes, at its end the lengths of the sections (u16 each, 0 for one that is
left out); the sections in order, each padded to a multiple of four; the signature over all of it.
docs/model-image.md has it in full. The caller verifies the signature first (signature.py); what is signed
is checked all the same (model_check.py).
"""

from array import array

from firmware_py import constant, evaluator, forcemap, geometry, memory, model_check, status, unpack

const = constant.const

PROBE = geometry.NAME
MAGIC = b"PALP"
VERSION = 5
HEAD_SIZE = 104
ROLLBACK = 1
MAX_COUNTER = (1 << 30) - 1

# where the head's fields begin, in bytes; docs/model-image.md says what they are
_VERSION = const(4)
_KIND = const(5)
_FEATURES_VERSION = const(6)
_FLAGS = const(7)
_LENGTH = const(8)
_COUNTER = const(12)
_REPLACES = const(16)
_CHECKS = const(20)  # length of the checks' section
_PROBE = const(24)
_MODEL_ID = const(40)
_TRAINING = const(48)
_LENGTHS = const(80)  # of the sections, from the first on

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
FIRST_STAGE = 12  # of a model of two stages (stage_image.py)
LAST = 12
CHECKS = 13  # laid out as a first stage; a firmware that does not know of it refuses the image

TESTED = evaluator.LEVEL  # integers of an estimate that a self-test vector fixes
DISTANCE_BITS = model_check.DISTANCE_BITS


def u32(b, at):
    """Little-endian number of four bytes."""
    return b[at] | b[at + 1] << 8 | b[at + 2] << 16 | b[at + 3] << 24


class Header:
    """The head of an image; `code` says what is wrong with it, if anything."""

    def __init__(self, read, body, probe=PROBE):
        self.code = status.OK
        b = read(0, HEAD_SIZE)
        if len(b) < HEAD_SIZE or b[:4] != MAGIC:
            self.code = status.BAD_MAGIC
            return
        if b[_VERSION] != VERSION:
            self.code = status.BAD_VERSION
            return
        self.kind = b[_KIND]
        self.features_version = b[_FEATURES_VERSION]
        self.rollback = b[_FLAGS] & ROLLBACK
        self.counter = u32(b, _COUNTER)
        self.replaces = u32(b, _REPLACES)
        self.probe = bytes(b[_PROBE:_MODEL_ID])
        self.model_id = bytes(b[_MODEL_ID:_TRAINING])
        self.training = bytes(b[_TRAINING:_LENGTHS])
        if u32(b, _LENGTH) != body:
            self.code = status.BAD_LENGTH
            return
        if self.probe != probe + bytes(16 - len(probe)):
            self.code = status.BAD_PROBE
            return
        if (
            self.kind > 1
            or b[_FLAGS] > ROLLBACK
            or u32(b, _CHECKS) > 0xFFFF
            or self.counter > MAX_COUNTER
            or self.replaces > MAX_COUNTER
            or (self.replaces and not self.rollback)
        ):
            self.code = status.BAD_MODEL
            return
        self.places = {}
        at = HEAD_SIZE
        for tag in range(1, LAST + 1):
            n = b[_LENGTHS + 2 * tag - 2] | b[_LENGTHS + 2 * tag - 1] << 8
            self.places[tag] = (at, n)
            at += n + 3 & -4
        n = u32(b, _CHECKS)
        self.places[CHECKS] = (at, n)
        at += n + 3 & -4
        if at != body:
            self.code = status.BAD_LENGTH

    def section(self, read, tag):
        """Bytes of a section; empty if the image has none of that tag."""
        at, n = self.places[tag]
        return bytes(read(at, n)) if n else b""


def load(read, body, features_version, feature_count, probe=PROBE):
    """(status, model) of an image of `body` bytes, signature not counted; the model is None unless OK.

    read(offset, n) gives bytes; features_version and feature_count say what this firmware computes.
    """
    try:
        return _load(read, body, features_version, feature_count, probe)
    except (ValueError, OverflowError, IndexError):  # a word that does not fit its place
        return status.BAD_MODEL, None
    except MemoryError:
        return status.NO_SPACE, None


def _load(read, body, features_version, feature_count, probe):
    h = Header(read, body, probe)
    if h.code != status.OK:
        return h.code, None
    # features are only ever added
    if not 0 < h.features_version <= features_version:
        return status.BAD_VERSION, None
    numbers = h.section(read, NUMBERS)
    steps = h.section(read, STEPS)
    sizes = numbers[unpack.NUMBERS_HEAD : unpack.NUMBERS_BYTES]
    n = model_check.features(numbers)
    counts = unpack.program(steps, n) if n else None
    if counts is None:
        return status.BAD_LENGTH, None
    # the large arrays first: what is read for a moment would leave no such piece on a small board
    leaves, branches, outer = counts
    outputs = evaluator.OUTPUTS
    two = outputs * (leaves + outputs + n)
    coarse = n * (n + 1) // 2
    c = array("h", bytearray(2 * (two + coarse)))
    d = array("h", bytearray(2 * two))
    own = array("i", bytearray(4 * outputs * branches))
    words, length = h.places[WORDS]
    parts = [b"", numbers, b"", b"", steps, length]
    for tag in (IDS, FEATURES):
        parts[tag] = h.section(read, tag)
    parts += [h.section(read, tag) for tag in range(ROWS, SELF_TEST)]
    staged = h.places[FIRST_STAGE][1] > 0
    code = model_check.check(parts, counts, feature_count, model_check.MOST_VALUES if staged else 0)
    if code != status.OK:
        return code, None
    ids = model_check.places(parts[IDS], feature_count)
    head = unpack.head(numbers)
    limits = array("i", parts[LIMITS])
    head[evaluator.N_LIMITS] = len(limits) // 3
    head[evaluator.LEAVES] = leaves
    head[evaluator.STEPS] = outer
    head[evaluator.SUMS] = outputs
    low = head[evaluator.LOW_BITS]
    sigma = words + ((leaves + branches) * sum(sizes[:outputs]) + 7) // 8
    start = sigma + ((outputs + n) * sum(sizes[outputs:]) + 7) // 8
    unpack.share(steps, outer, unpack.Numbers(read, words, sizes[:outputs]), head, c, d, own)
    more = unpack.Numbers(read, sigma, sizes[outputs:])
    unpack.pieces(more.take(outputs * (outputs + n)), low, c, d, outputs * leaves)
    for k, v in enumerate(unpack.Numbers(read, start, (DISTANCE_BITS,)).take(coarse)):
        c[two + k] = v
    memory.tidy()
    tables = evaluator.Tables(
        ids,
        unpack.feats(parts[FEATURES]),
        steps,
        c,
        d,
        own,
        unpack.rows(parts[ROWS]),
        unpack.outs(parts[OUTPUTS], unpack.links(numbers)),
        limits,
        head,
    )
    moves = forcemap.load(parts[FORCE_MAP]) if parts[FORCE_MAP] else None
    model = evaluator.Model(tables, moves, h, h.places[SELF_TEST])
    parts = []
    code, first, checks = _stages(h, read, feature_count)
    if code != status.OK:
        return code, None
    if first and max(ids) >= feature_count + first.count:
        return status.MISSING_FEATURE, None
    if first:
        from firmware_py import stage

        model.first = first
        model.evaluate = stage.Staged(first, tables).evaluate
    if checks:
        from firmware_py import stage

        model.checks = checks
        model.evaluate = stage.Checked(checks, first, tables).evaluate
    return status.OK, model


def _stages(h, read, feature_count):
    """(status, first stage, checks), either of the last two None where the image has none."""
    first = checks = None
    code = status.OK
    if h.places[FIRST_STAGE][1] or h.places[CHECKS][1]:
        from firmware_py import stage_image

        memory.tidy()
        if h.places[FIRST_STAGE][1]:
            code, first = stage_image.load(h.section(read, FIRST_STAGE), feature_count)
        if code == status.OK and h.places[CHECKS][1]:
            values = first.count if first else 0
            code, checks = stage_image.load(h.section(read, CHECKS), feature_count, values)
    return code, first, checks


def self_test(model, read, feature_count):
    """Run the vectors that travel in the model's image; OK if every integer is as stated, else SELF_TEST.

    Section: count, number of extra features, their ids; padding; their values; then for each vector one byte
    a feature (how far into its clip box, in 1/256) and, padded, the integers of its estimate.
    """
    at, n = model.tested
    raw = bytes(read(at, n)) if n else b""
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
    # the second stage by itself where there are two: the first has a vector of its own
    x = array("i", bytearray(4 * max(feature_count, max(t.ids) + 1)))
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
        t.evaluate(x, out)
        for i in range(TESTED):
            if out[i] != values[k * TESTED + i]:
                return status.SELF_TEST
    return status.OK


def place(feats, i, byte):
    """Feature i of a self-test vector."""
    at = evaluator.FEATURE_ROW * i
    lo = feats[at]
    return lo + (feats[at + evaluator.CLIP_HI] - lo >> 8) * byte

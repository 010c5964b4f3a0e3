"""The press before a stroke: how deep, wide, peaked and far across the image is at parts of its force.

What lies under the skin is told by how these change with the force, and every stroke begins by pressing.
Of each frame between contact and the start are kept the logarithms of force, depth, width and centre share,
and the outer columns' share. When the stroke's force is known a weighted parabola in ln F gives the last four
at a quarter, at half and at all of it. Q24; docs/features.md has the formulas.
"""

from array import array

from firmware_py import constant, features, fixed, geometry, profile

const = constant.const

_ln = fixed.ln
_mul = fixed.mul
_ratio = fixed.ratio

MOST = const(32)  # frames that are kept; of a longer press every second, every fourth and so on
KEPT = const(
    5
)  # of a frame: ln force (Q5 counts), ln depth (mm), ln width (mm), ln centre share, outer share
FEWEST = const(6)  # frames
_CURVES = const(4)
_FIRST = features.PRESS  # of the first three's features
_FIRST_OUTER = features.PRESS_OUTER  # and of the last's

# how good the last press was
GOOD = const(0)
FEW = const(1)  # too few frames of the forces that count
NARROW = const(2)  # they do not reach from about a quarter of the stroke's force to all of it

_LOWEST = -33554432  # ln(force / stroke's) of a frame that counts: -2 ..
_HIGHEST = 6710886  # .. to .4
_LOW_END = -17616077  # -1.05, ln .35: a frame at this part of the force or less is wanted,
_HIGH_END = -3355443  # and one at this part or more: -.2, ln .82
_BENT = const(8388)  # 5e-4: the least mean square of the parabola's own part, else it is no parabola
_STEEPEST = const(67108864)  # 4: of slope and bend
_MOST_SHARE = const(33554432)  # 2
_HALF_LN = const(11629080)  # ln 2
_LN_1000 = const(115892902)
_LEAST_UM = const(20)
LEAST = const(10)  # Q5 counts of two sensors, about 1 Pa
# errors of a frame's logarithms as variances, Q26: 50 um of the displacement, 20 Pa of an image's mean, .4 %
_MODEL = const(1074)
_MOST_VARIANCE = const(0x10000000)
_LN_50_UM = -50260047  # of 50 um, mm
_NOISE_MPA = geometry.ROWS * 32 * 20000  # 20 Pa as an image's sum in Q5 counts, times a count's mPa

_ROWS = geometry.ROWS
_HALF = geometry.HALF_ROWS
_MIDDLE = profile.MIDDLE
_SHIFT = profile.SPREAD_SHIFT
_LN_SPREAD = features.LN_SPREAD
_LN_SHARE = features.LN_SHARE
_LN_HALF_PITCH = features.LN_HALF_PITCH


def look(rows, depth_um, out, at):
    """The numbers of one frame into out[at..]; rows: of `Pipeline.look`."""
    total = 0
    middle = 0
    spread = 0
    a = _ROWS - 1
    for i in range(_HALF):
        v = rows[i] + rows[_ROWS - 1 - i]
        if v < LEAST:
            v = LEAST
        total += v
        if a < _MIDDLE:
            middle += v
        spread += v * a * a >> _SHIFT
        a -= 2
    of_total = _ln(total)
    out[at] = of_total
    out[at + 1] = _ln(depth_um if depth_um > _LEAST_UM else _LEAST_UM) - _LN_1000
    out[at + 2] = ((_ln(spread) + _LN_SPREAD - of_total) >> 1) + _LN_HALF_PITCH
    out[at + 3] = _ln(middle) - of_total + _LN_SHARE
    share = _ratio(rows[_ROWS], total)
    if share > _MOST_SHARE:
        share = _MOST_SHARE
    out[at + 4] = share if share > -_MOST_SHARE else -_MOST_SHARE


def halve(kept):
    """Keep every second frame."""
    for k in range(MOST // 2):
        for i in range(KEPT):
            kept[KEPT * k + i] = kept[2 * KEPT * k + i]


def variance(ln_error, ln_value):
    """Square of error over value, Q26, held at 4."""
    v = fixed.exp(2 * (ln_error - ln_value), -2)
    return v if v < _MOST_VARIANCE else _MOST_VARIANCE


def weigh(kept, n, ln_force, ln_noise, depth, w):
    """Weights of the n frames, their sum 1, into w; those of other forces are 0.

    depth: whether they are those of the displacement. Returns how many frames count.
    """
    least = 0x3FFFFFFF
    used = 0
    for k in range(n):
        x = kept[KEPT * k] - ln_force
        w[k] = 0
        if _LOWEST <= x <= _HIGHEST:
            v = variance(ln_noise, kept[KEPT * k]) + _MODEL
            if depth:
                v += variance(_LN_50_UM, kept[KEPT * k + 1])
            w[k] = v
            least = v if v < least else least
            used += 1
    total = 0
    for k in range(n):
        if w[k]:
            w[k] = _ratio(least, w[k])
            total += w[k]
    rest = 0x1000000
    best = 0
    for k in range(n):
        if w[k]:
            w[k] = _ratio(w[k], total)
            rest -= w[k]
            if w[k] > w[best]:
                best = k
    if used:
        w[best] += rest
    return used


def spans(kept, n, ln_force):
    """Whether the frames that count reach from about a quarter of the force to all of it."""
    low = high = _HIGHEST + 1
    for k in range(n):
        x = kept[KEPT * k] - ln_force
        if _LOWEST <= x <= _HIGHEST:
            if low > _HIGHEST:
                low = high = x
            low = x if x < low else low
            high = x if x > high else high
    return low <= _LOW_END and _HIGH_END <= high <= _HIGHEST


def held(v):
    """A slope or bend within what a press can have."""
    if v > _STEEPEST:
        return _STEEPEST
    return v if v > -_STEEPEST else -_STEEPEST


def parabola(kept, n, ln_force, which, w, out, at):
    """Value `which` of the kept frames at a quarter, at half and at all of the force, into out[at..].

    Least squares on polynomials that are orthogonal under the weights, so that nothing is solved for:
    p1 = x - m, p2 = p1^2 - s p1 - b. Returns False, and leaves `out`, where forces are too few for it.
    """
    m = 0
    mean = 0
    for k in range(n):
        if w[k]:
            m += _mul(w[k], kept[KEPT * k] - ln_force)
            mean += _mul(w[k], kept[KEPT * k + which])
    b = 0
    c = 0
    for k in range(n):
        if w[k]:
            p = kept[KEPT * k] - ln_force - m
            q = _mul(p, p)
            b += _mul(w[k], q)
            c += _mul(w[k], _mul(q, p))
    if b < 16 * _BENT:
        return False
    s = _ratio(c, b)
    bent = 0
    slope = 0
    bend = 0
    for k in range(n):
        if w[k]:
            p = kept[KEPT * k] - ln_force - m
            q = _mul(p, p) - _mul(s, p) - b
            y = kept[KEPT * k + which] - mean
            if y > _STEEPEST >> 1:
                y = _STEEPEST >> 1
            elif y < -_STEEPEST >> 1:
                y = -_STEEPEST >> 1
            bent += _mul(w[k], _mul(q, q))
            slope += _mul(w[k], _mul(p, y))
            bend += _mul(w[k], _mul(q, y))
    if bent < _BENT:
        return False
    slope = held(_ratio(slope, b))
    bend = held(_ratio(bend, bent))
    for j in range(3):
        p = (j - 2) * _HALF_LN - m
        q = _mul(p, p) - _mul(s, p) - b
        out[at + j] = mean + _mul(slope, p) + _mul(bend, q)
    return True


class Press:
    """The frames of the last press.

    Attributes
    ----------
    open : whether frames are taken: from contact to the start of the stroke
    n : how many are kept
    code : GOOD, FEW or NARROW, of the last `measure`
    """

    def __init__(self):
        self.kept = array("i", bytes(4 * KEPT * MOST))
        self.open = False
        self.n = 0
        self.code = FEW
        self._every = 1
        self._wait = 0

    def begin(self):
        """The probe has touched the skin: forget the last press."""
        self.open = True
        self.n = 0
        self._every = 1
        self._wait = 0

    def due(self):
        """Whether the next frame is one to be kept. Allocates nothing, as `add`."""
        self._wait -= 1
        if self._wait > 0:
            return False
        self._wait = self._every
        return True

    def add(self, rows, depth_um):
        """Keep a frame: the image (`Pipeline.look`), and the displacement."""
        if self.n == MOST:
            halve(self.kept)
            self.n = MOST // 2
            self._every *= 2
            self._wait = self._every
        look(rows, depth_um, self.kept, KEPT * self.n)
        self.n += 1

    def measure(self, kept, force, count_mpa, out, w):
        """Fill the features of the press, of a stroke with this mean force (sum of an image, Q5 counts).

        kept: what was kept of the frames, or what stands in for it; w: working space of MOST numbers.
        """
        ln_force = _ln(force)
        ln_noise = _ln(_NOISE_MPA // count_mpa)
        self.code = GOOD if spans(kept, self.n, ln_force) else NARROW
        at = _FIRST
        for i in range(_CURVES):
            if i == _CURVES - 1:
                at = _FIRST_OUTER
            if i < 2 and weigh(kept, self.n, ln_force, ln_noise, i == 0, w) < FEWEST:
                self.code = FEW
            if self.code == GOOD and not parabola(kept, self.n, ln_force, i + 1, w, out, at):
                self.code = NARROW
            at += 3
        if self.code != GOOD:
            features.no_press(out)

"""A reference press, once a visit, beside the lump: what it says of the tissue joins each stroke's own press.

The probe hangs in the air, is pressed straight down, as hard as the strokes, lifted, and hangs in the air for
another second. The zero is taken on both sides, as it drifts. Loaded for that time only (memory.forget): what
stays are three numbers in the model's first stage (stage.py).
"""

from array import array

from firmware_py import constant, features, fixed, geometry, press, stage, status

const = constant.const

_ROWS = geometry.ROWS
_AIR = const(8)  # frames in the air before the press, at least
_MEAN = const(16)  # of so many and fewer the zero is the mean; older ones count less and less
_DYING = const(24)  # frames after it in which the cells still read something
_AFTER = const(16)  # and that make the zero after them
_MOST = const(3000)  # frames until somebody has pressed and let up
_ALONG_UM = const(2000)  # a press does not move along
_IMAGE = _ROWS + 1  # numbers of Pipeline.look
_KEPT = _IMAGE + 2  # of a frame: its image, Q5 counts, the displacement, its number


def takes(model):
    """Whether this model (evaluator.Model, or None) can do something with a reference."""
    first = model.first if model else None
    if first is None or not len(first.refers):
        return False
    for i in first.ids:
        if i != stage.LN_FORCE and not of_press(i):
            return False
    return True


def of_press(i):
    """Whether feature i is one of the press."""
    return features.PRESS <= i < features.PRESS + 9 or features.PRESS_OUTER <= i < features.BUMP


def answer(kind, first):
    """What the command is answered with: whether there is one; ln of E_fat in kPa, ln t, ln layers."""
    if first is None or not first.held:
        return status.OK, (kind, 0, 0, 0, 0), b""
    fat, t, layers = first.reference
    return status.OK, (kind, 1, -fat, t, layers), b""


class Taking:
    """The frames of one reference.

    Parameters: pipeline (pipeline.Pipeline, between strokes); first (stage.Stage, which keeps the result), or
    None to leave it at the pipeline's features.
    """

    def __init__(self, pipeline, first=None):
        self._pipeline = pipeline
        self._first = first
        self._frames = 0
        # sums over frames in the air before and after: of what is kept of a frame; then how many
        self._before = array("i", bytes(4 * (_KEPT + 1)))
        self._after = array("i", bytes(4 * (_KEPT + 1)))
        self._last = array("i", bytes(4 * _KEPT))  # one that counts once another one in the air has followed
        self._waits = False
        self._kept = array("i", bytes(4 * _KEPT * press.MOST))
        self._n = 0
        self._every = 1
        self._wait = 0
        self._place_um = 0
        self._top = 0
        self._pressed = False
        self._lifted = 0  # frames since

    def take_reference(self, packed, touches, position_um, displacement_um):
        """Take a frame; None until the press is over, then a status: OK where the first stage has it."""
        self._frames += 1
        if self._frames > _MOST:
            return status.BAD_PRESS if self._pressed else status.NO_PRESS
        if touches:
            return self._press(packed, position_um, displacement_um)
        if self._pressed:
            self._lifted += 1
            if self._lifted <= _DYING:
                return None
            self._put(self._last, 0, packed, displacement_um)
            add(self._after, self._last, _AFTER)
            return self._finish() if self._after[_KEPT] == _AFTER else None
        if self._waits:
            add(self._before, self._last, _MEAN)
        self._put(self._last, 0, packed, displacement_um)
        self._waits = True
        return None

    def answer(self, code):
        """What the command is answered with when `take_reference` has given this status."""
        return answer(0, self._first) if code == status.OK else (code, (), b"")

    def _put(self, out, at, packed, displacement_um):
        """A frame into out[at..]; the sum of its rows."""
        image = self._pipeline.look(packed)
        total = 0
        for i in range(_IMAGE):
            out[at + i] = image[i]
            if i < _ROWS:
                total += image[i]
        out[at + _IMAGE] = displacement_um
        out[at + _IMAGE + 1] = self._frames
        return total

    def _press(self, packed, position_um, displacement_um):
        if not self._pressed:
            if self._before[_KEPT] < _AIR:
                return status.IN_CONTACT
            self._pressed = True
            self._place_um = position_um
        if self._lifted:
            return status.BAD_PRESS  # touched again, before the air was seen
        if not -_ALONG_UM <= position_um - self._place_um <= _ALONG_UM:
            return status.MOVED
        self._wait -= 1
        if self._wait > 0 or self._wait < -_MOST:
            return None
        self._wait = self._every
        if self._n == press.MOST:
            self._n = thin(self._kept)
            self._every *= 2
        total = self._put(self._kept, _KEPT * self._n, packed, displacement_um)
        self._n += 1
        if total > self._top:
            self._top = total
        elif total < self._top - (self._top >> 2):
            self._n -= 1
            self._wait = -_MOST - 1  # the hand lets up: no more of it
        return None

    def _finish(self):
        p = self._pipeline
        p.press.begin()
        p.press.open = False
        top = 1
        work = self._last
        for k in range(self._n):
            total = 0
            for i in range(_KEPT - 1):
                work[i] = self._kept[_KEPT * k + i] - self._zero(i, self._kept[_KEPT * k + _KEPT - 1])
                if i < _ROWS:
                    total += work[i]
            top = max(top, total)
            p.press.add(work, work[_IMAGE])
        count_mpa = p.calibration.count_mpa
        x = p.features
        p.press.measure(p.press.kept, top, count_mpa, x, array("i", bytes(4 * press.MOST)))
        if p.press.code != press.GOOD:
            return status.BAD_PRESS
        x[stage.LN_FORCE] = fixed.ln(top) + features.LN_SUM_TO_N_PER_M + fixed.ln(count_mpa)
        first = self._first
        if first is None:
            return status.OK
        x = first.extend(x)
        at = first.feature_count
        if not first.ends[0] < x[at] < first.ends[1]:
            return status.FORCE_RANGE
        first.keep(x)
        return status.OK

    def _zero(self, i, frame):
        """Number i of a frame in the air at this time: on the line from before the press to after it."""
        a = self._before
        b = self._after
        n = a[_KEPT]
        m = b[_KEPT]
        begin = a[_KEPT - 1] // n
        drift = b[i] // m - a[i] // n
        return a[i] // n + drift * (frame - begin) // (b[_KEPT - 1] // m - begin)


def add(total, frame, most):
    """Add a frame in the air to the sums; of more than `most` the older ones count less and less."""
    if total[_KEPT] == most:
        for i in range(_KEPT + 1):
            total[i] >>= 1
    for i in range(_KEPT):
        total[i] += frame[i]
    total[_KEPT] += 1


def thin(kept):
    """Keep every second frame; how many are left."""
    for k in range(press.MOST // 2):
        for i in range(_KEPT):
            kept[_KEPT * k + i] = kept[2 * _KEPT * k + i]
    return press.MOST // 2

"""From calibrated rows to features.

pipeline.Pipeline keeps the frames. When the stroke is over it hands over each position bin's row means and
how deep it was; this does the rest.
"""

from array import array

from firmware_py import features, forcemap, gauss, gaussfit, geometry, profile, search, status, traces

POINTS = 57  # the map's places, 1 mm apart, 28 to either side of the lump
HALF_UM = 28000
PROFILE_UM = 34000  # where the profile ends
COVER_UM = 24000  # the stroke must reach this far to either side of the lump
GAP_UM = 4500  # and leave no longer gap on the way: sizes come out wrong otherwise, and nothing tells
PLACES = 128  # most places of the map in which the lump is searched
FEWEST = 8  # bins
_ROWS = geometry.ROWS
SUM_SHIFT = (_ROWS - 1) // 16  # an image sum less these bits fits what 16 rows need


def move_all(f, rows, depth, n, force, mean, w):
    """Move the n images and depths to the force `mean`; force[k]: the k-th image's sum over all columns."""
    wanted = features._ln(mean)
    for k in range(n):
        if force[k] > 2048:
            depth[k] = forcemap.move(f, rows, _ROWS * k, depth[k], wanted - features._ln(force[k]), w)


def widest_gap(x_um, n, low, high):
    """The longest gap between neighbouring bins between low and high."""
    gap = 0
    for k in range(n - 1):
        if x_um[k + 1] > low and x_um[k] < high and x_um[k + 1] - x_um[k] > gap:
            gap = x_um[k + 1] - x_um[k]
    return gap


class Chain:
    """Results of the last stroke, and the steps to them.

    Attributes
    ----------
    features : array('i'), see feature_names.NAMES, Q24
    map : array('i') of POINTS, Q11 counts
    fit : array('i'): base, amp (Q11 counts), centre (Q16 mm from the map's first point), stdev (Q16 mm), cost
    span : array('i'): first column used, one after the last
    place_um : the map's middle, in the encoder's coordinate
    force : mean sum of an image over all columns, Q5 counts
    n : how many position bins were filled
    """

    def __init__(self, calibration, n_bins):
        self.calibration = calibration
        self.features = array("i", bytes(4 * features.COUNT))
        self.map = array("i", bytes(4 * POINTS))
        self.fit = array("i", bytes(4 * gauss.PARAMS))
        self.span = array("i", (0, geometry.COLUMNS))
        self.profile = array("i", bytes(4 * profile.SIZE))
        self._x = array("i", bytes(4 * n_bins))
        self._depth = array("i", bytes(4 * n_bins))
        self._raw_depth = array("i", bytes(4 * n_bins))
        self._force = array("i", bytes(4 * n_bins))
        self._rows = array("i", bytes(4 * _ROWS * n_bins))
        self._wide = array("i", bytes(4 * PLACES))
        self._work = array("i", bytes(4 * gauss.WORK))
        self._small = array("i", bytes(4 * 64))
        self._best = array("i", bytes(4 * gauss.PARAMS))
        self._keep = array("i", bytes(4 * gauss.PARAMS))
        self._step = array("i", bytes(12))
        self.n = 0
        self.done = False
        self.place_um = 0
        self.force = 0

    def finish(self, force_map=None):
        """Work out map, fit and features. force_map: what forcemap.load returned, or None.

        Returns OK; NO_FIT where nothing rises (features are there, Amp is 0); TOO_SHORT where the stroke
        does not reach COVER_UM to both sides of the lump; TOO_SPARSE where its frames lie too far apart;
        UNEVEN where its force wandered too far; SATURATED where cells read full scale.
        May be called again with another map.
        """
        self._take()
        if self.n < FEWEST:
            return status.TOO_SHORT
        total = 0
        for k in range(self.n):
            total += self._force[k]
        self.force = total // self.n
        self._move(force_map)
        if not self._find():
            return status.TOO_SHORT
        if widest_gap(self._x, self.n, self._place - HALF_UM, self._place + HALF_UM) > GAP_UM:
            return status.TOO_SPARSE
        if self._uneven():
            return status.UNEVEN
        if self._saturated():
            return status.SATURATED
        code = self._fit()
        if code == status.OK and self._choose():
            self._move(force_map)
            code = self._fit()
        middle = self._measure()
        # the search keeps off the stroke's ends, the fit does not
        if code == status.OK and self._clear():
            if middle - self._x[0] < COVER_UM or self._x[self.n - 1] - middle < COVER_UM:
                return status.TOO_SHORT
        return code

    def _take(self):
        """Fill n, _x, _raw_depth, _rows and _force from the frames."""

    def _saturated(self):
        """Whether cells read full scale."""
        return False

    def _choose(self):
        """Find the columns that see the lump and fill _rows from them alone; True if they are not all."""
        return False

    def _origin(self):
        """The encoder's reading that _x counts from."""
        return 0

    def _move(self, force_map):
        for k in range(self.n):
            self._depth[k] = self._raw_depth[k]
        if force_map is not None and self.force > 2048:
            move_all(force_map, self._rows, self._depth, self.n, self._force, self.force, self._work)

    def _find(self):
        """Find the lump's place from a map over the whole stroke."""
        low = self._x[0]
        points = (self._x[self.n - 1] - low) // 1000 + 1
        if points > PLACES:
            points = PLACES
        margin = COVER_UM // 1000
        if points < 2 * margin + 1:
            return False
        # a lump is meant to lie about the middle: three quarters of what could be searched is left out
        if points > 2 * margin + 9:
            margin = points // 2 - (points // 2 - margin) * 3 // 4
        wide = self._wide
        traces.map_rows(self._x, self.n, self._rows, low, wide, points, self._small)
        if search.search(wide, points, margin, points - 1 - margin, self._work, self._best, self._step):
            place = self._best[0]
            self._width = self._best[1]
        else:
            place = points // 2
            self._width = 0
        self._place = low + 1000 * place
        self.place_um = self._origin() + self._place
        return True

    def _uneven(self):
        """Whether the force of the profile's frames swings by more than .3 of its mean to either side."""
        low = high = self.force
        for k in range(self.n):
            if -PROFILE_UM <= self._x[k] - self._place <= PROFILE_UM:
                low = min(low, self._force[k])
                high = max(high, self._force[k])
        return 5 * (high - low) > 3 * self.force

    def _fit(self):
        """The map about the place, and the Gaussian on it."""
        p = self.fit
        y = self.map
        traces.map_rows(self._x, self.n, self._rows, self._place - HALF_UM, y, POINTS, self._small)
        if self._width and gaussfit.fit_from(
            y, POINTS, p, self._best, self._work, self._small, self._step, 28, self._width, self._keep
        ):
            return status.OK
        gaussfit.flat(y, POINTS, p)
        return status.NO_FIT

    def _clear(self):
        """Whether the bump stands out of the map's misfit, so that its middle is no accident."""
        p = self.fit
        return 2 * features._ln(p[gauss.AMP]) - p[gauss.COST] + features._ln(POINTS) > gaussfit.WEAK

    def _measure(self):
        """Fill the profile and the features; returns the lump's middle, in the bins' micrometres."""
        middle = self._place + (self.fit[gauss.CENTRE] * 125 >> 13) - HALF_UM
        profile.measure(self._x, self.n, self._rows, self._depth, middle, self.profile, self._small)
        features.from_fit(self.fit, POINTS, self.features)
        features.from_profile(self.profile, self.features)
        force = self.force if self.force > 1 else 1
        features.finish(force, self.calibration.count_mpa, self.features)
        self._look_further(force)
        return middle

    def _look_further(self, force):
        """Fill the features of columns and press, of a stroke with this force."""

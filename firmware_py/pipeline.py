"""From frames to features: the whole chain in integers, the same on the probe and on the host.

    p = Pipeline(calibration)
    p.reset(); p.add_frame(packed, position_um, displacement_um); ...; p.finish(force_map)
    p.features

`finish` alone does the work; `add_frame` unpacks and adds, and allocates nothing.
"""

from array import array

from firmware_py import bins, calib, columns, features, forcemap, gauss, profile, search, status, traces

POINTS = 57  # the map's places, 1 mm apart, 28 to either side of the lump
HALF_UM = 28000
COVER_UM = 24000  # the stroke must reach this far to either side of the lump
GAP_UM = 8000  # and leave no longer gap on the way
PLACES = 128  # most places of the map that the lump is looked for in


def sum_rows(cells, slot, n, first, last, rows, total):
    """Mean over the columns first..last-1 of the n calibrated bins: 16 rows each and their sum, Q5 counts."""
    width = last - first
    at = 0
    for k in range(n):
        base = slot[k] * 416 + first
        t = 0
        for i in range(16):
            s = -4096 * width
            for j in range(base, base + width):
                s += cells[j]
            s = (s << 2) // width
            s = s if s < 131071 else 131071
            rows[at] = s
            t += s
            at += 1
            base += 26
        total[k] = t


def levels(force, mean, n, level):
    """mean / force of each bin in Q12, below 2."""
    for k in range(n):
        v = 4096
        if force[k] > 2048:
            v = (mean << 9) // (force[k] >> 3)
        level[k] = v if v < 8191 else 8191


def move_all(f, rows, depth, n, force, mean_ln, w):
    """Move the n images and depths to the force whose ln is mean_ln."""
    for k in range(n):
        if force[k] > 2048:
            u = mean_ln - features._ln(force[k])
            depth[k] = forcemap.move(f, rows, 16 * k, depth[k], u, w)


def widest_gap(x_um, n, low, high):
    """The longest way between neighbouring bins between low and high."""
    gap = 0
    for k in range(n - 1):
        if x_um[k + 1] > low and x_um[k] < high and x_um[k + 1] - x_um[k] > gap:
            gap = x_um[k + 1] - x_um[k]
    return gap


class Pipeline:
    """A stroke's frames in, its features out.

    calibration: calib.Calibration
    n_bins, width_um: how many position bins, and how wide; memory is 832 bytes a bin
    fixed_columns: (first, one after the last) to look at these only; None to find those that see the lump
    """

    def __init__(self, calibration, n_bins=bins.BINS, width_um=bins.WIDTH_UM, fixed_columns=None):
        self.calibration = calibration
        self.bins = bins.Bins(n_bins, width_um)
        self.fixed_columns = fixed_columns
        self.features = array("i", bytes(4 * features.COUNT))
        self.map = array("i", bytes(4 * POINTS))  # Q11 counts
        self.fit = array("i", bytes(4 * gauss.PARAMS))  # base, amp (Q11 counts), centre, stdev (Q16 mm), cost
        self.span = array("i", (0, calib.COLS))  # first column used, one after the last
        self.profile = array("i", bytes(4 * profile.SIZE))
        self.columns = array("i", bytes(4 * calib.COLS))  # how much of the bump each column sees, Q3 counts
        self._x = array("i", bytes(4 * n_bins))
        self._depth = array("i", bytes(4 * n_bins))
        self._raw_depth = array("i", bytes(4 * n_bins))
        self._force = array("i", bytes(4 * n_bins))
        self._slot = bytearray(n_bins)
        self._rows = array("i", bytes(64 * n_bins))
        self._work = array("i", bytes(4 * 256))
        self._small = array("i", bytes(4 * 64))
        self._best = array("i", bytes(4 * gauss.PARAMS))
        self._step = array("i", bytes(12))
        self._keep_fit = array("i", bytes(4 * gauss.PARAMS))
        self.reset()

    def reset(self):
        """Forget the stroke; the last results stay readable until `finish`."""
        self.bins.reset()
        self.n = 0
        self.done = False
        self.place_um = 0
        self.force = 0

    def add_frame(self, packed, position_um, displacement_um, at=0):
        """Add the packed frame at packed[at:]; returns OK, bins.IGNORED, bins.BEYOND or an error."""
        if self.done:
            return status.BAD_STATE
        if len(packed) - at < calib.FRAME_BYTES:
            return status.BAD_LENGTH
        return self.bins.add(packed, at, position_um, displacement_um)

    def finish(self, force_map=None):
        """Work out map, fit and features. force_map: what forcemap.load returned, or None.

        Returns OK; NO_FIT where nothing rises (features are there, Amp is 0); TOO_SHORT where the stroke
        does not reach COVER_UM to both sides of the lump. May be called again with another map.
        """
        self.span[0] = 0
        self.span[1] = calib.COLS
        if self.fixed_columns:
            self.span[0] = self.fixed_columns[0]
            self.span[1] = self.fixed_columns[1]
        self._calibrate()
        if self.n < 8:
            return status.TOO_SHORT
        self._move(force_map, True)
        if not self._find():
            return status.TOO_SHORT
        code = self._fit()
        if not self.fixed_columns and code == status.OK and self._choose():
            self._sum(self._work)
            self._move(force_map, False)
            code = self._fit()
        self._measure()
        return code

    def _calibrate(self):
        c = self.calibration
        b = self.bins
        if not self.done:
            self.done = True
            self.n = b.order(self._x, self._raw_depth, self._slot)
            calib.calibrate_bins(
                b.cells,
                self._slot,
                self.n,
                b.count,
                c.offset,
                c.gain,
                c.fill,
                c.fills,
                self._rows,
                self._force,
            )
            self._keep()
            if not self.fixed_columns:
                return
        self._sum(self._force)

    def _keep(self):
        for k in range(self.n):
            self._depth[k] = self._raw_depth[k]

    def _sum(self, force):
        s = self.span
        sum_rows(self.bins.cells, self._slot, self.n, s[0], s[1], self._rows, force)
        self._keep()

    def _move(self, force_map, first):
        if first:
            total = 0
            for k in range(self.n):
                total += self._force[k]
            self.force = total // self.n
        if force_map is not None and self.force > 2048:
            mean_ln = features._ln(self.force)
            move_all(force_map, self._rows, self._depth, self.n, self._force, mean_ln, self._work)

    def _find(self):
        """Find the lump's place from a map over the whole stroke."""
        low = self._x[0]
        reach = self._x[self.n - 1] - low
        points = reach // 1000 + 1
        if points > PLACES:
            points = PLACES
        margin = COVER_UM // 1000
        if points < 2 * margin + 1:
            return False
        if points > 2 * margin + 9:
            margin = points // 2 - (points // 2 - margin) * 3 // 4
        wide = array("i", bytes(4 * points))
        traces.map_rows(self._x, self.n, self._rows, low, wide, points, self._small)
        if search.search(wide, points, margin, points - 1 - margin, self._work, self._best):
            place = self._best[0]
            self._width = self._best[1]
        else:
            place = points // 2
            self._width = 0
        self._place = low + 1000 * place
        self.place_um = self.bins.origin_um + self._place
        return widest_gap(self._x, self.n, self._place - HALF_UM, self._place + HALF_UM) <= GAP_UM

    def _fit(self):
        """The map about the place, and the Gaussian on it."""
        p = self.fit
        traces.map_rows(self._x, self.n, self._rows, self._place - HALF_UM, self.map, POINTS, self._small)
        if self._width and gauss.fit_from(
            self.map,
            POINTS,
            p,
            self._best,
            self._work,
            self._small,
            self._step,
            28,
            self._width,
            self._keep_fit,
        ):
            return status.OK
        gauss.flat(self.map, POINTS, p)
        return status.NO_FIT

    def _choose(self):
        """Find the columns that see the lump; True if they are not all."""
        maps = array("i", bytes(4 * POINTS * calib.COLS))
        level = self._work
        levels(self._force, self.force, self.n, level)
        x = self._place - HALF_UM
        traces.map_columns(self._x, self.n, self.bins.cells, self._slot, level, x, maps, POINTS)
        if not columns.respond(maps, POINTS, self.fit[2], self.fit[3], self.columns, self._work):
            return False
        columns.choose(self.columns, self._small, self.span)
        return self.span[1] - self.span[0] < calib.COLS

    def _measure(self):
        middle = self._place + (self.fit[gauss.CENTRE] * 125 >> 13) - HALF_UM
        profile.measure(self._x, self.n, self._rows, self._depth, middle, self.profile, self._small)
        features.from_fit(self.fit, POINTS, self.features)
        features.from_profile(self.profile, self.features)
        features.finish(self.force if self.force > 1 else 1, self.calibration.count_mpa, self.features)

"""From frames to features: the whole chain in integers, the same on the probe and on the host.

    p = Pipeline(calibration)
    p.begin_press(); p.add_press(packed, displacement_um); ...
    p.reset(); p.add_frame(packed, position_um, displacement_um); ...; p.finish(force_map)
    p.features

`finish` alone does the work; `add_frame` unpacks and adds, and allocates nothing.
"""

from array import array

from firmware_py import (
    bins,
    calib,
    columns,
    feature_chain,
    features,
    gauss,
    geometry,
    memory,
    press,
    profile,
    status,
    stuck,
    traces,
)

POINTS = feature_chain.POINTS
HALF_UM = feature_chain.HALF_UM
_ROWS = geometry.ROWS
_COLUMNS = geometry.COLUMNS
_CELLS = geometry.CELLS
_SUM_SHIFT = feature_chain.SUM_SHIFT
OUTER = max(1, 4500 // geometry.PITCH_UM)  # columns at either side: 4.5 mm of the face
_MIDDLE = profile.MIDDLE
_FIRST_MIDDLE = (_ROWS - _MIDDLE) // 2
_TOGETHER = feature_chain.PLACES // POINTS  # columns whose maps lie in memory at a time


def sum_rows(cells, slot, n, first, last, rows, total):
    """Mean over the columns first..last-1 of the n calibrated bins: the rows and their sum, Q5 counts."""
    width = last - first
    at = 0
    for k in range(n):
        base = slot[k] * _CELLS + first
        t = 0
        for i in range(_ROWS):
            s = -4096 * width
            for j in range(base, base + width):
                s += cells[j]
            s = (s << 2) // width
            s = s if s < 131071 else 131071
            rows[at] = s
            t += s
            at += 1
            base += _COLUMNS
        total[k] = t


def levels(force, mean, n, level):
    """mean / force of each bin in Q12, below 2."""
    for k in range(n):
        v = 4096
        if force[k] > 2048:
            v = (mean << 9 - _SUM_SHIFT) // (force[k] >> 3 + _SUM_SHIFT)
        if v > 8191:
            v = 8191
        elif v < 0:
            v = 0
        level[k] = v


class Pipeline(feature_chain.Chain):
    """A stroke's frames in, its features out; see feature_chain.Chain for the results.

    Parameters
    ----------
    calibration : calib.Calibration
    n_bins, width_um : int
        How many position bins, and how wide; memory is two bytes a cell and bin.
    once : bool
        `finish` is asked for once a stroke; so the rows need not be kept as they were, which is 4 kB.
    """

    def __init__(self, calibration, n_bins=bins.BINS, width_um=bins.WIDTH_UM, once=False):
        feature_chain.Chain.__init__(self, calibration, n_bins)
        self.press = press.Press()
        self.bins = bins.Bins(n_bins, width_um)
        self.columns = array("i", bytes(4 * _COLUMNS))  # how much of the bump each column sees, Q3 counts
        self.stuck = 0  # how many cells hung all along, and were mended
        self.full = 0  # how many cells, at most, read full scale in one bin
        self.hung = array("h", bytes(4 * stuck.MOST))
        self._slot = bytearray(n_bins)
        # rows over all columns, before cells were rounded
        self._exact = self._rows if once else array("i", bytes(4 * _ROWS * n_bins))
        self.reset()

    def reset(self):
        """Forget the stroke; the last results stay readable until `finish`. The press is over."""
        self.press.open = False
        self.bins.reset()
        self.n = 0
        self.done = False

    def add_frame(self, packed, position_um, displacement_um, at=0):
        """Add the packed frame at packed[at:]; returns OK, bins.IGNORED, bins.BEYOND or an error."""
        if self.done:
            return status.BAD_STATE
        if len(packed) - at < geometry.FRAME_BYTES:
            return status.BAD_LENGTH
        return self.bins.add(packed, at, position_um, displacement_um)

    def begin_press(self):
        """The probe touches the skin; of a stroke that has ended before only the features are left."""
        self.press.begin()

    def add_press(self, packed, displacement_um, at=0):
        """Add the packed frame at packed[at:] to the press, until the stroke begins. Allocates nothing."""
        if len(packed) - at < geometry.FRAME_BYTES:
            return status.BAD_LENGTH
        p = self.press
        if not p.open or not p.due():
            return status.OK
        p.add(self.look(packed, at), displacement_um)
        return status.OK

    def look(self, packed, at=0):
        """The image of the packed frame at packed[at:], in memory that the next look writes over.

        ROWS + 1 numbers, Q5 counts: the rows, and what they would add up to if all cells read as the middle
        ones of the outer columns do. Before a stroke only: no stroke is in the bins as long as the probe is
        pressed, so the first is lent.
        """
        b = self.bins
        c = self.calibration
        b.count[0] = 1
        self._slot[0] = 0
        bins.put_cells(packed, at, b.cells, 0)
        calib.calibrate_bins(
            b.cells, self._slot, 1, b.count, c.offset, c.gain, c.fill, c.fills, self._exact, self._force
        )
        image = self._exact
        rows = self._work
        outer = 0
        first = 0
        while first < _COLUMNS:
            sum_rows(b.cells, self._slot, 1, first, first + OUTER, rows, self._small)
            for i in range(_MIDDLE):
                outer += rows[_FIRST_MIDDLE + i]
            first += _COLUMNS - OUTER
        image[_ROWS] = outer * _ROWS // (2 * _MIDDLE)
        return image

    def _look_further(self, force):
        columns.rings(self.columns, self._small, self.features, features.ACROSS)
        kept = self.press.kept
        if self.stuck:
            from firmware_py import hanging  # seldom needed: a board has no room for it at other times

            kept = hanging.mended(self)
            memory.forget(("hanging",))
        self.press.measure(kept, force, self.calibration.count_mpa, self.features, self._small)

    def _origin(self):
        return self.bins.origin_um

    def _take(self):
        c = self.calibration
        b = self.bins
        span = self.span
        span[0] = 0
        span[1] = _COLUMNS
        for i in range(_COLUMNS):
            self.columns[i] = 0
        if not self.done:
            self.done = True
            self.n = b.order(self._x, self._raw_depth, self._slot)
            self.stuck = 0
            if self.n >= feature_chain.FEWEST:
                self.stuck = stuck.mend(b.cells, self._slot, self.n, b.count, c.dead, self._work, self.hung)
            self._count_full()
            calib.calibrate_bins(
                b.cells,
                self._slot,
                self.n,
                b.count,
                c.offset,
                c.gain,
                c.fill,
                c.fills,
                self._exact,
                self._force,
            )
        if self._exact is not self._rows:
            for i in range(_ROWS * self.n):
                self._rows[i] = self._exact[i]

    def _count_full(self):
        """Fill `full` from the raw sums; the greatest of a bin is soon found, and seldom at full scale."""
        b = self.bins
        cells = memoryview(b.cells)
        self.full = 0
        for k in range(self.n):
            base = self._slot[k] * _CELLS
            most = geometry.FULL_COUNT * b.count[self._slot[k]]
            if max(cells[base : base + _CELLS]) >= most:
                self.full = max(self.full, stuck.full(b.cells, base, most, self.calibration.dead))

    def _saturated(self):
        return self.full >= stuck.FULL

    def _choose(self):
        """Find the columns that see the lump and sum the rows over them; True if they are not all."""
        span = self.span
        cells = self.bins.cells
        bump = self._small
        norm = columns.make_bump(POINTS, self.fit[gauss.CENTRE], self.fit[gauss.STDEV], bump)
        if not norm:
            return False
        level = self._work
        levels(self._force, self.force, self.n, level)
        x = self._place - HALF_UM
        maps = self._wide
        for first in range(0, _COLUMNS, _TOGETHER):
            n = min(_TOGETHER, _COLUMNS - first)
            traces.map_columns(self._x, self.n, cells, self._slot, level, x, maps, POINTS, first, n)
            columns.respond(maps, POINTS, bump, norm, self.columns, first, n)
        columns.choose(self.columns, self._small, span)
        if span[1] - span[0] == _COLUMNS:
            return False
        # the force stays that of all columns: a hand presses on the whole face
        sum_rows(cells, self._slot, self.n, span[0], span[1], self._rows, self._work)
        columns.even_out(self._x, self.n, self._place, self._rows, self._work, self._force, self.force)
        return True

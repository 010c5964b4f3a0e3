"""The small build: 4 kB for a stroke in place of 53, at the price of fixed columns.

Each frame is calibrated as it comes and summed over the columns that were chosen beforehand, so nothing is
left to look for the lump across the stroke: a ball must be stroked with those columns. FIXED_COLUMNS says so.
"""

from array import array

from firmware_py import bins, feature_chain, geometry, status

FIXED_COLUMNS = True
_ROWS = geometry.ROWS
_COLUMNS = geometry.COLUMNS


def add_rows(packed, at, first, last, offset, gain, rows, base):
    """Add each row's calibrated counts (1/128) in the columns first..last-1 to rows[base..base+ROWS)."""
    for r in range(_ROWS):
        s = 0
        cell = _COLUMNS * r + first
        end = _COLUMNS * r + last
        while cell < end:
            p = (
                at + (cell >> 1) * 3
            )  # unpacked here: this build has no room for a frame's counts (bins.put_cells)
            if cell & 1:
                v = packed[p + 1] >> 4 | packed[p + 2] * 16
            else:
                v = packed[p] | (packed[p + 1] & 15) * 256
            s += (v * 8 - offset[cell]) * gain[cell] >> 9
            cell += 1
        rows[base + r] += s


def mean_rows(sums, counts, slot, n, live, rows, total):
    """Means of the sums over frames and live columns, Q5 counts, in the bins' order, and each image's sum."""
    for k in range(n):
        t = 0
        for r in range(_ROWS):
            v = sums[_ROWS * slot[k] + r] // (counts[slot[k]] * live[r] * 4)
            if v > 131071:
                v = 131071
            elif v < -131071:
                v = -131071
            rows[_ROWS * k + r] = v
            t += v
        total[k] = t


class RowPipeline(feature_chain.Chain):
    """A stroke's frames in, its features out, from fixed columns; see feature_chain.Chain for the results.

    Parameters
    ----------
    calibration : calib.Calibration
    first, last : int
        The columns first..last-1 are used.
    n_bins, width_um : int
        How many position bins, and how wide.
    """

    def __init__(self, calibration, first=0, last=_COLUMNS, n_bins=bins.BINS, width_um=bins.WIDTH_UM):
        feature_chain.Chain.__init__(self, calibration, n_bins)
        self.span[0] = first
        self.span[1] = last
        self._places = bins.Places(n_bins, width_um)
        self._sums = array("i", bytes(4 * _ROWS * n_bins))
        self._slot = bytearray(n_bins)
        self._live = bytearray(_ROWS)
        self.reset()

    def reset(self):
        """Forget the stroke; the last results stay readable until `finish`."""
        self._places.reset()
        self.n = 0
        self.done = False

    def add_frame(self, packed, position_um, displacement_um, at=0):
        """Add the packed frame at packed[at:]; returns OK, bins.IGNORED, bins.BEYOND or an error."""
        if self.done:
            return status.BAD_STATE
        if len(packed) - at < geometry.FRAME_BYTES:
            return status.BAD_LENGTH
        k = self._places.enter(position_um, displacement_um)
        if k < 0:
            return self._places.why
        base = _ROWS * k
        if self._places.count[k] == 1:
            for i in range(base, base + _ROWS):
                self._sums[i] = 0
        c = self.calibration
        add_rows(packed, at, self.span[0], self.span[1], c.offset, c.gain, self._sums, base)
        return status.OK

    def _origin(self):
        return self._places.origin_um

    def _take(self):
        self.done = True
        dead = self.calibration.dead
        for r in range(_ROWS):
            n = 0
            for cell in range(_COLUMNS * r + self.span[0], _COLUMNS * r + self.span[1]):
                if not dead[cell >> 3] >> (cell & 7) & 1:
                    n += 1
            self._live[r] = n if n else 1
        self.n = self._places.order(self._x, self._raw_depth, self._slot)
        mean_rows(self._sums, self._places.count, self._slot, self.n, self._live, self._rows, self._force)

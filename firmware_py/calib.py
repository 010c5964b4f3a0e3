"""Per-cell calibration: offset, gain and the dead cells, which live neighbours stand in for.

Calibrated pressure is kept in eighths of a nominal count; `count_mpa` (millipascal per nominal
count) turns it into a pressure at the very end.
"""

from array import array

from firmware_py import constant, geometry, status

const = constant.const

ROWS = geometry.ROWS
COLS = geometry.COLUMNS
CELLS = geometry.CELLS
FRAME_BYTES = geometry.FRAME_BYTES
UNIT_GAIN = 8192  # gain 1 in Q13
BIAS = 4096  # added to a calibrated cell, so that noise below zero survives in 16 bits
COUNT_MPA = geometry.COUNT_MPA
PEDESTAL = geometry.PEDESTAL_PA * 8 * geometry.FULL_COUNT // geometry.FULL_SCALE_PA  # eighths of a count
BLOB_BYTES = 8 + 4 * CELLS + geometry.MASK_BYTES

# places in the blob, in bytes
_TAG = const(0)  # 0x43
_VERSION_AT = const(1)
_ROWS_AT = const(2)
_COLUMNS_AT = const(3)
_COUNT_MPA = const(4)  # four bytes, of which the last is 0
_OFFSETS = const(8)  # two bytes for each cell; then the gains, then the mask of dead cells
_VERSION = 1


def calibrate_bins(cells, slot, n, counts, offset, gain, fill, fills, rows, total):
    """Turn the raw sums of n bins into calibrated means, in place, and fill their dead cells.

    A cell becomes its pressure in 1/8 count, BIAS added, held in 16 bits. rows[ROWS k + i] becomes the mean
    over all columns of row i in the k-th bin, Q5 counts, before that rounding; total[k] their sum.
    """
    rows_ = ROWS
    columns = COLS
    for k in range(n):
        base = slot[k] * CELLS
        count = counts[slot[k]]
        i = 0
        at = rows_ * k
        end = at + rows_
        while at < end:
            s = 0
            e = i + columns
            while i < e:
                # times 8, not shifted: an unsigned number shifted would stay unsigned once compiled
                v = (cells[base + i] * 8 // count - offset[i]) * gain[i] >> 9
                s += v
                v = (v >> 4) + 4096
                if v < 0:
                    v = 0
                elif v > 65535:
                    v = 65535
                cells[base + i] = v
                i += 1
            rows[at] = s
            at += 1
        # a dead cell's gain is 0, so it has added nothing so far
        i = 0
        while i < fills:
            v = (cells[base + fill[i + 1]] + cells[base + fill[i + 2]]) >> 1
            cells[base + fill[i]] = v
            rows[rows_ * k + fill[i] // columns] += (v - 4096) << 4
            i += 3
        s = 0
        for at in range(rows_ * k, end):
            v = rows[at] // (4 * columns)
            if v > 131071:
                v = 131071
            elif v < -131071:
                v = -131071
            rows[at] = v
            s += v
        total[k] = s


def plan_fill(dead, fill):
    """List (dead cell, one source, other source) in `fill`; returns how many numbers were written.

    The sources are the nearest live cells of the same row on either side, else of the same column.
    """
    n = 0
    for i in range(CELLS):
        if not (dead[i >> 3] >> (i & 7)) & 1:
            continue
        col = i % COLS
        a = -1
        b = -1
        k = 1
        while k < COLS and (a < 0 or b < 0):
            if a < 0 and col - k >= 0 and not (dead[(i - k) >> 3] >> ((i - k) & 7)) & 1:
                a = i - k
            if b < 0 and col + k < COLS and not (dead[(i + k) >> 3] >> ((i + k) & 7)) & 1:
                b = i + k
            k += 1
        k = COLS
        while k < CELLS and a < 0 and b < 0:
            if i - k >= 0 and not (dead[(i - k) >> 3] >> ((i - k) & 7)) & 1:
                a = i - k
            if i + k < CELLS and not (dead[(i + k) >> 3] >> ((i + k) & 7)) & 1:
                b = i + k
            k += COLS
        if a < 0:
            a = b
        if b < 0:
            b = a
        if a >= 0:
            fill[n] = i
            fill[n + 1] = a
            fill[n + 2] = b
            n += 3
    return n


class Calibration:
    """Turns counts into pressure: `offset` (1/8 count), `gain` (Q13), `dead` (one bit a cell)."""

    def __init__(self, count_mpa=COUNT_MPA):
        self.count_mpa = count_mpa
        self.offset = array("H", bytes(2 * CELLS))
        self.gain = array("H", bytes(2 * CELLS))
        for i in range(CELLS):
            self.offset[i] = PEDESTAL
            self.gain[i] = UNIT_GAIN
        self.dead = bytearray(geometry.MASK_BYTES)
        self.fill = array("H", bytes(6))
        self.fills = 0

    def set_dead(self, cells):
        """Mark dead cells (an iterable of cell indices) and plan their filling; this cannot be undone."""
        for i in cells:
            self.dead[i >> 3] |= 1 << (i & 7)
        self._plan()

    def dead_cells(self):
        """How many cells are marked dead."""
        n = 0
        for i in range(CELLS):
            n += self.dead[i >> 3] >> (i & 7) & 1
        return n

    def _plan(self):
        n = 0
        for i in range(CELLS):
            if self.dead[i >> 3] >> (i & 7) & 1:
                self.gain[i] = 0
                n += 1
        self.fill = array("H", bytes(6 * (n or 1)))
        self.fills = plan_fill(self.dead, self.fill)

    def zero(self, total, count):
        """Take offsets from `count` unloaded frames whose raw sums are in `total`; what never moves is dead.

        A cell at either rail has no offset and is marked dead.
        """
        for i in range(CELLS):
            v = (total[i] << 3) // count
            if v < 8 or v > 32751:
                self.dead[i >> 3] |= 1 << (i & 7)
            else:
                self.offset[i] = v
        self._plan()

    def to_bytes(self):
        """The calibration as BLOB_BYTES bytes, little endian, for the store and the wire."""
        out = bytearray(BLOB_BYTES)
        out[_TAG] = 0x43
        out[_VERSION_AT] = _VERSION
        out[_ROWS_AT] = ROWS
        out[_COLUMNS_AT] = COLS
        for i in range(4):
            out[_COUNT_MPA + i] = self.count_mpa >> (8 * i) & 255
        p = _OFFSETS
        for values in (self.offset, self.gain):
            for v in values:
                out[p] = v & 255
                out[p + 1] = v >> 8
                p += 2
        out[p:] = self.dead
        return bytes(out)

    def load(self, blob):
        """Load a calibration written by `to_bytes`; returns a status and changes nothing on failure."""
        if len(blob) != BLOB_BYTES:
            return status.BAD_LENGTH
        if blob[_TAG] != 0x43 or blob[_VERSION_AT] != _VERSION:
            return status.BAD_VERSION
        if blob[_ROWS_AT] != ROWS or blob[_COLUMNS_AT] != COLS:
            return status.BAD_PROBE
        mpa = blob[_COUNT_MPA] | blob[_COUNT_MPA + 1] << 8 | blob[_COUNT_MPA + 2] << 16
        if blob[_OFFSETS - 1] or mpa < 1:
            return status.BAD_VALUE
        for i in range(_OFFSETS, _OFFSETS + 4 * CELLS, 2):
            # an offset or gain of 2^15 and more would leave the integer range
            if blob[i + 1] > 127:
                return status.BAD_VALUE
        self.count_mpa = mpa
        p = _OFFSETS
        for values in (self.offset, self.gain):
            for i in range(CELLS):
                values[i] = blob[p] | blob[p + 1] << 8
                p += 2
        for i in range(geometry.MASK_BYTES):
            self.dead[i] = blob[p + i]
        self._plan()
        return status.OK

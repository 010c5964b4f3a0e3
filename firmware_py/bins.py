"""Position bins: raw frames are summed where the probe stood, so that a frame costs no multiplication.

Calibration is linear, so it is applied once to each bin's sum when the stroke is over. A bin holds
at most 16 frames: the sum of 16 counts of 12 bits still fits 16 bits. Bins form a ring, so the probe
may move either way from wherever it starts. Lengths in micrometres.
"""

from array import array

from firmware_py import geometry, memory, status

BINS = memory.BINS
WIDTH_UM = 1500
LONGEST_UM = 250000  # a longer distance times 2^12 would leave the integer range
IGNORED = 1  # the frame's bin is full (the probe stands still): leaving it out loses nothing
BEYOND = 2  # the frame lies further from the others than the ring reaches

_CELLS = geometry.CELLS
_FRAME_BYTES = geometry.FRAME_BYTES
_FAR = 0x20000000
_DEEP = 0x20000


# What reads a frame unpacks it in its own loop, here and elsewhere: a call for each pair of cells would take
# longer than all the rest, and a frame's counts as an array memory that a small board has not.
def put_cells(packed, at, cells, base):
    """Unpack a frame's counts of 12 bits from `packed[at:]` into `cells[base:]`."""
    end = at + _FRAME_BYTES
    while at < end:
        b = packed[at + 1]
        cells[base] = packed[at] | (b & 15) << 8
        cells[base + 1] = b >> 4 | packed[at + 2] << 4
        at += 3
        base += 2


def add_cells(packed, at, cells, base):
    """Unpack a frame's counts of 12 bits from `packed[at:]` and add them to `cells[base:]`."""
    end = at + _FRAME_BYTES
    while at < end:
        b = packed[at + 1]
        cells[base] += packed[at] | (b & 15) << 8
        cells[base + 1] += b >> 4 | packed[at + 2] << 4
        at += 3
        base += 2


class Places:
    """The bins' places: how many frames each holds, and the sums of where they were and how deep."""

    def __init__(self, bins=BINS, width_um=WIDTH_UM):
        if not 8 <= bins <= 255 or not 100 <= width_um <= LONGEST_UM // bins:
            raise ValueError(
                "%d bins of %d um: no more than 255, and %d um in all" % (bins, width_um, LONGEST_UM)
            )
        self.bins = bins
        self.width_um = width_um
        self.count = bytearray(bins)
        self.x_sum = array("i", bytes(4 * bins))
        self.d_sum = array("i", bytes(4 * bins))
        self.why = status.OK
        self.reset()

    def reset(self):
        """Forget the stroke."""
        self.origin_um = 0
        self.low = 0
        self.high = -1
        self.frames = 0
        for i in range(self.bins):
            self.count[i] = 0

    def enter(self, position_um, displacement_um):
        """Enter a frame; returns its bin's slot, or -1 and in `why` IGNORED, BEYOND or BAD_VALUE."""
        if not -_FAR < position_um < _FAR or not -_DEEP < displacement_um < _DEEP:
            self.why = status.BAD_VALUE
            return -1
        if self.high < self.low:
            self.origin_um = position_um
            self.low = self.high = 0
        x = position_um - self.origin_um
        b = x // self.width_um
        if b >= self.low + self.bins or b <= self.high - self.bins:
            self.why = BEYOND
            return -1
        k = b % self.bins
        n = self.count[k]
        if n >= 16:
            self.why = IGNORED
            return -1
        x -= b * self.width_um
        if n:
            x += self.x_sum[k]
            displacement_um += self.d_sum[k]
        self.x_sum[k] = x
        self.d_sum[k] = displacement_um
        self.count[k] = n + 1
        self.frames += 1
        if b < self.low:
            self.low = b
        elif b > self.high:
            self.high = b
        return k

    def order(self, x_um, d_um, slot):
        """Write the filled bins in rising position: mean place from the origin, mean depth (1/16 um), slot.

        Returns how many there are.
        """
        n = 0
        b = self.low
        while b <= self.high:
            k = b % self.bins
            c = self.count[k]
            if c:
                x_um[n] = b * self.width_um + self.x_sum[k] // c
                d_um[n] = (self.d_sum[k] << 4) // c
                slot[n] = k
                n += 1
            b += 1
        return n


class Bins(Places):
    """The stroke so far: the places, and per bin the cells' raw sums."""

    def __init__(self, bins=BINS, width_um=WIDTH_UM):
        Places.__init__(self, bins, width_um)
        self.cells = memory.cells(_CELLS * bins)

    def add(self, packed, at, position_um, displacement_um):
        """Add one frame; OK, IGNORED, BEYOND or BAD_VALUE. Allocates nothing."""
        k = self.enter(position_um, displacement_um)
        if k < 0:
            return self.why
        if self.count[k] == 1:
            put_cells(packed, at, self.cells, k * _CELLS)
        else:
            add_cells(packed, at, self.cells, k * _CELLS)
        return status.OK

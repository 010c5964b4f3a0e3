"""Zeroing and gain calibration on the probe: the mean of some frames becomes offsets or gains."""

from array import array

from firmware_py import calib, geometry, messages, status

_CELLS = geometry.CELLS
_FULL_SCALE = geometry.FULL_COUNT * 8
_MOST_DEAD = _CELLS // 4  # so many at once are no broken cells: nothing presses, or no cable is plugged in


def square_root(n):
    """The integer square root of 0 <= n < 2**30."""
    root = 0
    bit = 1 << 14
    while bit:
        if (root + bit) * (root + bit) <= n:
            root += bit
        bit >>= 1
    return root


def add_frame(packed, total, before, first):
    """Add a frame's counts to `total`, keep them in `before`.

    Sum of squared differences from the one before; 1000 counts and more are a blow to the probe, not noise.
    """
    squares = 0
    at = 0
    for i in range(0, _CELLS, 2):
        b = packed[at + 1]  # unpacked here: no call for each pair (bins.put_cells)
        v = packed[at] | (b & 15) << 8
        w = b >> 4 | packed[at + 2] << 4
        at += 3
        total[i] += v
        total[i + 1] += w
        if not first:
            d = v - before[i]
            if -1000 < d < 1000:
                squares += d * d
            d = w - before[i + 1]
            if -1000 < d < 1000:
                squares += d * d
        before[i] = v
        before[i + 1] = w
    return squares


class Calibrator:
    """Collects the frames of one calibrate command.

    Parameters: calibration (calib.Calibration, changed only by `finish`), kind (messages.CALIBRATE_...),
    frames to take (1 to 255), pressure_pa on the whole face (for the gain).
    """

    def __init__(self, calibration, kind, frames, pressure_pa):
        self.calibration = calibration
        self.kind = kind
        self.frames = frames
        self.pressure_pa = pressure_pa
        self.taken = 0
        self._total = array("i", bytes(4 * _CELLS))
        self._before = array("H", bytes(2 * _CELLS))
        self._squares = 0

    def take(self, packed):
        """Take one frame (geometry.FRAME_BYTES); True when there are enough."""
        squares = add_frame(packed, self._total, self._before, self.taken == 0)
        self._squares += squares // _CELLS
        self.taken += 1
        return self.taken >= self.frames

    def noise_millicounts(self):
        """Standard deviation of a cell from frame to frame, mean over the cells.

        0 if only one frame was taken.
        """
        if self.taken < 2:
            return 0
        # the mean square difference of two frames is twice the variance; 31 = sqrt(1000) about, so that
        # the root
        # is taken of a number below 2**30
        mean = min(self._squares * 500 // (self.taken - 1), (1 << 30) - 1)
        return square_root(mean) * 31623 // 1000

    def finish(self):
        """Update the calibration from the frames taken; return a status."""
        c = self.calibration
        if self.kind == messages.CALIBRATE_ZERO:
            before = c.dead_cells()
            c.set_dead(())
            c.zero(self._total, self.taken)
            return status.OK if c.dead_cells() - before < _MOST_DEAD else status.BAD_CALIBRATION
        dead = [i for i in range(_CELLS) if c.dead[i >> 3] >> (i & 7) & 1]
        expected = self.pressure_pa * 1000 // c.count_mpa * 8
        if expected < 800 or expected > _FULL_SCALE:
            return status.BAD_VALUE
        before = len(dead)
        for i in range(_CELLS):
            felt = (self._total[i] << 3) // self.taken - c.offset[i]
            # a cell that reads under a quarter, or over four times, of the applied pressure is broken
            if felt * 4 <= expected or felt >= expected * 4:
                if i not in dead:
                    dead.append(i)
            else:
                c.gain[i] = min(expected * calib.UNIT_GAIN // felt, 32767)
        c.set_dead(dead)
        return status.OK if len(dead) - before < _MOST_DEAD else status.BAD_CALIBRATION

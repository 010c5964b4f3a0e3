"""Watches the frames go by: contact, start, lump passed, end of a stroke; force and speed out of range.

Integers only, and nothing is allocated. Pressures are means over the cells at the nominal scale
(geometry.FULL_SCALE_PA), which is enough to tell events; estimates use the calibrated pipeline.
"""

from array import array

from firmware_py import counters, geometry, messages, settings

IDLE = 0
CONTACT = 1
STROKE = 2

_MASK = counters.MASK
_ROWS = geometry.ROWS
_PAIRS_A_ROW = geometry.COLUMNS // 2
# rows from 4.5 to 9 mm to either side of the middle see the lump before it does, well inside the contact
_EDGE_FIRST = (_ROWS - geometry.rows_within(9000)) // 2
_EDGE_ROWS = max(1, (geometry.rows_within(9000) - geometry.rows_within(4501)) // 2)
_EDGE_UM = (
    -geometry.FIRST_ROW_UM - _EDGE_FIRST * geometry.PITCH_UM - (_EDGE_ROWS - 1) * geometry.PITCH_UM // 2
)
_COUNTS_A_100_PA = geometry.COUNTS_A_100_PA
_COUNTS_A_PA = _COUNTS_A_100_PA // 100
_FACE_10_UM = geometry.LENGTH_UM // 10
_RISE = 33  # share of an edge's pressure, over 1024: rise that tells a lump, about 3 %
_SPEED_MS = 100  # the encoder's noise would drown a speed taken from frame to frame

_LIFTED = 1 << messages.STATE_LIFTED
_CONTACT = 1 << messages.STATE_CONTACT
_STARTED = 1 << messages.STATE_STARTED
_PASSED = 1 << messages.STATE_LUMP_PASSED
_ENDED = 1 << messages.STATE_ENDED
_LOW = 1 << messages.STATE_FORCE_LOW
_HIGH = 1 << messages.STATE_FORCE_HIGH
_FAST = 1 << messages.STATE_TOO_FAST


def row_sums(packed, sums):
    """Sum of each row's counts in a packed frame, into geometry.ROWS numbers."""
    at = 0
    for row in range(_ROWS):
        line = 0
        for _ in range(_PAIRS_A_ROW):
            b = packed[at + 1]  # unpacked here: no call for each pair (bins.put_cells)
            line += (packed[at] | (b & 15) << 8) + (b >> 4 | packed[at + 2] << 4)
            at += 3
        sums[row] = line


class Edge:
    """One end of the probe: its share of the pressure, and whether a bump has come and gone."""

    def __init__(self):
        self.reset()

    def reset(self):
        """A new stroke begins."""
        self.low = 0
        self.high = 0
        self.peak_um = 0
        self.passed = False

    def update(self, share, position_um):
        """Take the next share (over 1024, smoothed by the caller); True once, when a bump has been passed."""
        if self.passed:
            return False
        if self.low == 0 or share < self.low:
            self.low = share
            self.high = share
        if share > self.high:
            self.high = share
            self.peak_um = position_um
        rise = self.high - self.low
        if rise * 1024 > _RISE * self.low and share < self.high - (rise >> 1):
            self.passed = True
        return self.passed


class StrokeState:
    """What is going on.

    Parameters: values, the list Settings.values (read at each frame); zero_counts, sum of all cells' zeros.
    """

    def __init__(self, values, zero_counts=geometry.COUNTS_A_100_PA * geometry.PEDESTAL_PA // 100):
        self.values = values
        self.zero_counts = zero_counts
        self.head = Edge()
        self.tail = Edge()
        self.state = IDLE
        self.pressure_pa = 0
        self.force_mN_per_m = 0
        self.speed_um_per_s = 0
        self.lump_um = 0
        self.frames = 0
        self._head_sum = 0
        self._tail_sum = 0
        self._sums = array("i", bytes(4 * _ROWS))
        self.reset()

    def reset(self):
        """As if lifted off."""
        self.state = IDLE
        self.frames = 0
        self._told = 0  # which warnings stand
        self._contact_um = 0
        self._last_um = 0
        self._last_us = 0
        self._moved_us = 0
        self._moved_um = 0

    def _sum(self, packed):
        """Sum of a frame's counts, and of those of the edges' rows."""
        sums = self._sums
        row_sums(packed, sums)
        total = 0
        head = 0
        tail = 0
        for row in range(_ROWS):
            line = sums[row]
            total += line
            if _EDGE_FIRST <= row < _EDGE_FIRST + _EDGE_ROWS:
                head += line
            elif _EDGE_FIRST <= _ROWS - 1 - row < _EDGE_FIRST + _EDGE_ROWS:
                tail += line
        self._head_sum = head
        self._tail_sum = tail
        return total

    def _pressure(self, packed):
        """Mean over the cells, Pa."""
        return (self._sum(packed) - self.zero_counts) * 100 // _COUNTS_A_100_PA

    def in_contact(self, packed):
        """True where a frame alone would begin a contact."""
        return self._pressure(packed) >= self.values[settings.CONTACT_THRESHOLD]

    def _warn(self, which, stands):
        """The event's bit, once when the condition begins to hold."""
        if not stands:
            self._told &= ~which
            return 0
        if self._told & which:
            return 0
        self._told |= which
        return which

    def update(self, packed, position_um, time_us):
        """Take one packed frame; return the events as bits `1 << messages.STATE_...`."""
        values = self.values
        pressure = self._pressure(packed)
        self.pressure_pa = pressure
        self.force_mN_per_m = pressure * _FACE_10_UM // 100
        events = 0
        threshold = values[settings.CONTACT_THRESHOLD]
        if self.state == IDLE:
            if pressure >= threshold:
                self.state = CONTACT
                self._contact_um = position_um
                self._moved_um = position_um
                self._moved_us = time_us
                self._last_um = position_um
                self._last_us = time_us
                self.speed_um_per_s = 0
                self._told = 0
                events = _CONTACT
        elif pressure < threshold - (threshold >> 2):
            events = _LIFTED
            if self.state == STROKE:
                events |= _ENDED
            self.state = IDLE
        else:
            events = self._in_contact(position_um, time_us)
        return events

    def _in_contact(self, position_um, time_us):
        values = self.values
        events = 0
        ms = counters.elapsed(time_us, self._last_us) // 1000
        if ms >= _SPEED_MS:
            step = position_um - self._last_um
            if step < 0:
                step = -step
            if step > 1000000:
                step = 1000000
            self.speed_um_per_s = step * 1000 // ms
            self._last_um = position_um
            self._last_us = time_us
        if self.state == CONTACT:
            travel = position_um - self._contact_um
            if travel >= values[settings.STROKE_START] or -travel >= values[settings.STROKE_START]:
                self.state = STROKE
                self.frames = 0
                self.head.reset()
                self.tail.reset()
                self._moved_um = position_um
                self._moved_us = time_us
                events = _STARTED
        if self.state == STROKE:
            self.frames += 1
            events |= self._warn(_FAST, self.speed_um_per_s > values[settings.SPEED_LIMIT])
            events |= self._warn(_LOW, self.force_mN_per_m < values[settings.FORCE_LOW])
            events |= self._warn(_HIGH, self.force_mN_per_m > values[settings.FORCE_HIGH])
            events |= self._look_for_lump(position_um)
            moved = position_um - self._moved_um
            if moved > 100 or moved < -100:
                self._moved_um = position_um
                self._moved_us = time_us
            elif counters.elapsed(time_us, self._moved_us) // 1000 >= values[settings.STROKE_PAUSE]:
                self.state = CONTACT
                self._contact_um = position_um
                events |= _ENDED
        return events

    def _look_for_lump(self, position_um):
        zero = self.zero_counts * _EDGE_ROWS // _ROWS
        total = (
            self.pressure_pa * _COUNTS_A_PA // 16 + 1
        )  # a sixteenth of all counts: 64 / total is 1024 / all
        found = 0
        if self.head.update((self._head_sum - zero) * 64 // total, position_um):
            self.lump_um = self.head.peak_um - _EDGE_UM
            found = _PASSED
        elif self.tail.update((self._tail_sum - zero) * 64 // total, position_um):
            self.lump_um = self.tail.peak_um + _EDGE_UM
            found = _PASSED
        if found:
            self.head.passed = True
            self.tail.passed = True
        return found

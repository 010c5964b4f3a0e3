"""The probe's settings: 32-bit numbers with limits (messages.SETTINGS), kept in the store."""

import struct

from firmware_py import messages, status

NAME = "settings"

FRAME_RATE = 0
CONTACT_THRESHOLD = 1
FORCE_LOW = 2
FORCE_HIGH = 3
SPEED_LIMIT = 4
STROKE_START = 5
STROKE_PAUSE = 6
RESEND_RESULTS = 7


_LOWEST = tuple([definition[3] for definition in messages.SETTINGS])
_HIGHEST = tuple([definition[4] for definition in messages.SETTINGS])
_DEFAULTS = tuple([definition[5] for definition in messages.SETTINGS])


class Settings:
    """Values by key, kept in a record (safe_record.Record) whenever one changes; None: kept nowhere.

    `state` is the record's at the start: with ROTTEN the defaults stand in for what had been set.
    """

    def __init__(self, record=None):
        self.values = list(_DEFAULTS)
        self.state = status.OK
        self._record = record
        if record:
            stored = record.restore()
            self.state = record.state
            if stored:
                self._restore(stored)

    def _restore(self, stored):
        """Take what an earlier run kept; a key that is gone or out of limits falls back to its default."""
        for i in range(len(stored) // 5):
            key, value = struct.unpack_from("<Bi", stored, 5 * i)
            if key < len(self.values) and _LOWEST[key] <= value <= _HIGHEST[key]:
                self.values[key] = value
        for low, high in messages.ORDERED:
            if self.values[low] >= self.values[high]:
                self.values[low] = _DEFAULTS[low]
                self.values[high] = _DEFAULTS[high]

    def limits(self, key):
        """Lowest and highest value that a setting takes now: force_low stays below force_high."""
        lowest = _LOWEST[key]
        highest = _HIGHEST[key]
        for low, high in messages.ORDERED:
            if key == low:
                highest = min(highest, self.values[high] - 1)
            if key == high:
                lowest = max(lowest, self.values[low] + 1)
        return lowest, highest

    def check(self, key, value):
        """OK, or BAD_VALUE if there is no such key or the value is outside its limits."""
        if key >= len(self.values):
            return status.BAD_VALUE
        lowest, highest = self.limits(key)
        return status.OK if lowest <= value <= highest else status.BAD_VALUE

    def set(self, key, value):
        """Change and keep a value; return a status. A value that could not be kept is not changed."""
        code = self.check(key, value)
        if code != status.OK or (self.values[key] == value and self.state != status.ROTTEN):
            return code
        before = self.values[key]
        self.values[key] = value
        if self._record:
            code = self._record.save(self.pack())
            if code != status.OK:
                self.values[key] = before
        return code

    def damage(self):
        """What was found damaged at the start, as bits messages.DAMAGED_...; told until the next start."""
        if self.state == status.ROTTEN:
            return messages.DAMAGED_SETTINGS
        return messages.DAMAGE_REPAIRED if self.state == status.REPAIRED else 0

    def pack(self):
        """The values as they are kept: key (1 byte) and value (4), one after the other."""
        return b"".join([struct.pack("<Bi", i, v) for i, v in enumerate(self.values)])

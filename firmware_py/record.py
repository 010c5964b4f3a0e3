"""A byte string that a power cut leaves whole, old or new: two copies, each with a number and a CRC-32.

A save goes to the copy that does not hold the newest valid content, is synced and read back. So the
newest content is never touched before its successor is safe. Used for the calibration, the settings
and the record of which model slot is live.

Layout of a copy: number (4, little endian), length (4), content, CRC-32 of all that (4).
"""

from firmware_py import crc, status

EXTRA = 12
_LAST = (1 << 30) - 1


class Record:
    """The record `name` in a store; its copies are called name + "0" and name + "1"."""

    def __init__(self, store, name):
        self.store = store
        self.name = name
        self._newest = 1  # so that the very first save goes to copy 0
        self._number = 0

    def _read(self, copy):
        """(number, content) of a copy, number -1 unless it is whole."""
        name = self.name + "01"[copy]
        size = self.store.size(name)
        if size < EXTRA:
            return -1, b""
        b = bytearray(self.store.read(name, 0, size))
        if len(b) != size or not crc.check(b, size):
            return -1, b""
        number = b[0] | b[1] << 8 | b[2] << 16 | b[3] << 24
        length = b[4] | b[5] << 8 | b[6] << 16 | b[7] << 24
        if length != size - EXTRA or not 0 < number <= _LAST:
            return -1, b""
        return number, bytes(b[8 : 8 + length])

    def load(self):
        """The newest whole content, or None if there is none."""
        best = None
        self._newest = 1
        self._number = 0
        for copy in range(2):
            number, content = self._read(copy)
            if number > self._number:
                self._newest = copy
                self._number = number
                best = content
        return best

    def save(self, content):
        """Make `content` the record's content. OK, or STORE_ERROR with the old content in place."""
        self.load()
        copy = 1 - self._newest
        number = self._number + 1
        n = len(content)
        b = bytearray(n + EXTRA)
        for i in range(4):
            b[i] = number >> 8 * i & 255
            b[4 + i] = n >> 8 * i & 255
        b[8 : 8 + n] = content
        crc.append(b, 8 + n)
        name = self.name + "01"[copy]
        code = self.store.create(name, b)
        if code != status.OK:
            return code
        self.store.sync()
        if self.store.read(name, 0, n + EXTRA) != b:
            return status.STORE_ERROR
        self._newest = copy
        self._number = number
        return status.OK

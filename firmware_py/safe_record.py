"""A byte string that a power cut leaves whole, old or new, and that outlives a flipped bit.

Two copies of the same content, each with a number and a CRC-32. A save goes to one copy, is synced and read
back, and then to the other; so the newest content is never touched before its successor is safe, and what
rots in one copy is repaired from the other. Used for the calibration, the settings, the key and the record
of which model slot is live.

Layout of a copy: number (4, little endian), length (4), content, CRC-32 of all that (4).
"""

from firmware_py import crc, status

EXTRA = 12
_LAST = (1 << 30) - 1


class Record:
    """The record `name` in a store; its copies are called name + "0" and name + "1".

    `state` after a load: OK; REPAIRED where a copy is damaged and the other whole; ROTTEN where there was
    content and neither copy is whole.
    """

    def __init__(self, store, name):
        self.store = store
        self.name = name
        self.state = status.OK
        self._newest = 1  # so that the very first save goes to copy 0
        self._number = 0
        self._alike = True

    def _read(self, copy):
        """(number, content) of a copy; number -1 where it is damaged, 0 where it is not there."""
        name = self.name + "01"[copy]
        size = self.store.size(name)
        if size <= 0:
            return 0, b""
        b = bytearray(self.store.read(name, 0, size)) if size >= EXTRA else b""
        if len(b) != size or not crc.check(b, size):
            return -1, b""
        number = b[0] | b[1] << 8 | b[2] << 16 | b[3] << 24
        length = b[4] | b[5] << 8 | b[6] << 16 | b[7] << 24
        if length != size - EXTRA or not 0 < number <= _LAST:
            return -1, b""
        return number, bytes(b[8 : 8 + length])

    def load(self):
        """The newest whole content, or None if there is none."""
        n0, c0 = self._read(0)
        n1, c1 = self._read(1)
        # with none whole the first save goes to copy 0; with both the same, too
        self._newest = 0 if n0 > n1 else 1
        self._number = max(n0, n1, 0)
        self._alike = n0 == n1 and c0 == c1
        best = c0 if n0 > n1 else c1
        self.state = status.OK
        if self._number and (n0 < 0 or n1 < 0):
            self.state = status.REPAIRED
        elif n0 < 0 and n1 < 0:
            # one damaged and the other not there is the first save of all, cut short
            self.state = status.ROTTEN
        return best if self._number else None

    def restore(self):
        """The newest whole content; where a copy of it is damaged or missing, it is written again."""
        best = self.load()
        if best is not None and not self._alike:
            self._write(1 - self._newest, best, self._number)
        return best

    def save(self, content):
        """Make `content` the record's content. A status; unless it is OK the old content stays."""
        self.load()
        copy = 1 - self._newest
        number = self._number + 1
        code = self._write(copy, content, number)
        if code == status.OK:
            self._newest = copy
            self._number = number
            # it is safe already: what fails now is repaired by the next `restore`
            self._write(1 - copy, content, number)
        return code

    def _write(self, copy, content, number):
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
        return status.OK if self.store.read(name, 0, n + EXTRA) == b else status.STORE_ERROR

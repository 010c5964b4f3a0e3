"""Where the probe keeps what must outlive its power: named byte strings, files in a directory.

Any object with the same six methods serves (sim/probe/flash_sim.py has one that loses its power).
Writes may be lost until `sync` returns; nothing here is atomic. safe_record.py and slots.py build atomic
records on top of it.
"""

import os

from firmware_py import status


class FileStore:
    """Files in the directory `root` ("" for the board's own root); names are short and flat."""

    def __init__(self, root=""):
        self.root = root + "/" if root and not root.endswith("/") else root

    def size(self, name):
        """Bytes of a name, -1 if there is none."""
        try:
            return os.stat(self.root + name)[6]
        except OSError:
            return -1

    def read(self, name, offset, n):
        """Up to n bytes from an offset; fewer at the end, none if there is no such name."""
        try:
            with open(self.root + name, "rb") as f:
                if offset:
                    f.seek(offset)
                return f.read(n)
        except OSError:
            return b""

    def create(self, name, data=b""):
        """Put `data` in the place of whatever the name held. A status."""
        return self._put(name, "wb", data)

    def append(self, name, data):
        """Add `data` at the end. A status."""
        return self._put(name, "ab", data)

    def _put(self, name, mode, data):
        try:
            with open(self.root + name, mode) as f:
                done = f.write(data)
                if hasattr(os, "fsync"):
                    f.flush()
                    os.fsync(f.fileno())
        except OSError:
            return status.STORE_ERROR
        return status.OK if done == len(data) else status.NO_SPACE

    def remove(self, name):
        """Forget a name; no matter if it is not there."""
        try:
            os.remove(self.root + name)
        except OSError:
            pass

    def sync(self):
        """Return once everything written so far will survive a loss of power."""
        if hasattr(os, "sync") and not hasattr(os, "fsync"):
            os.sync()

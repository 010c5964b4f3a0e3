"""The board that `firmware_py.probe` runs on in an emulated probe. Written for both interpreters."""

import sys

try:
    import hostport
except ImportError:
    from sim.probe.device import hostport

try:
    from firmware_py import record
except ImportError:

    class record:
        class Record:
            def __init__(self, *a):
                pass

            def load(self):
                return None

            def save(self, d):
                return 0


if sys.implementation.name == "micropython":
    from uctypes import addressof
else:

    def addressof(buffer):
        """CPython's hostport takes the buffer itself."""
        return buffer


_read = hostport.read
_write = hostport.write
_scan = hostport.scan


class HostStore:
    """Files of the host, one by one: the interface of firmware_py/store.py over hostport."""

    def size(self, name):
        return hostport.store_size(name)

    def read(self, name, offset, buffer):
        return hostport.store_read(name, offset, addressof(buffer), len(buffer))

    def write(self, name, offset, data):
        return hostport.store_write(name, offset, addressof(data), len(data))

    def sync(self):
        return hostport.store_sync()

    def remove(self, name):
        return hostport.store_remove(name)


def estimator_of(board):
    return None


class EmulatedBoard:
    """See firmware_py/boards/__init__.py for what each member does."""

    def __init__(self):
        self.store = HostStore()
        self.serial = bytes([hostport.serial_byte(i) for i in range(8)])
        self.boots = hostport.boots()
        self._settings = record.Record(self.store, "set")
        self.begin = hostport.begin
        self.end = hostport.end
        self.ticks_us = hostport.ticks_us
        self.idle = hostport.idle
        self.position_um = hostport.position_um
        self.displacement_um = hostport.displacement_um

    def read(self, buffer):
        return _read(addressof(buffer), len(buffer))

    def write(self, buffer, start, stop):
        return _write(addressof(buffer), start, stop)

    def scan(self, counts):
        _scan(addressof(counts))

    def kept_settings(self):
        return self._settings.load()

    def keep_settings(self, data):
        return self._settings.save(data)

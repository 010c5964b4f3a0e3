"""The board that `firmware_py.probe` runs on in an emulated probe. Written for both interpreters."""

import sys

try:
    import hostport
except ImportError:
    from palpate.sim.probe.device import hostport

from firmware_py import estimator, flash, safe_record

if sys.implementation.name == "micropython":
    from uctypes import addressof
else:

    def addressof(buffer):
        """CPython's hostport takes the buffer itself."""
        return buffer


KEY_BYTES = 64  # no public key is longer

_read = hostport.read
_write = hostport.write
_scan = hostport.scan


class HostStore:
    """Files of the host, one by one: the interface of firmware_py/store.py over hostport."""

    def size(self, name):
        return hostport.store_size(name)

    def read(self, name, offset, n):
        buffer = bytearray(n)
        got = hostport.store_read(name, offset, addressof(buffer), n)
        return bytes(buffer[:got])

    def create(self, name, data=b""):
        hostport.store_remove(name)
        return hostport.store_write(name, 0, addressof(data), len(data))

    def append(self, name, data):
        return hostport.store_write(name, max(self.size(name), 0), addressof(data), len(data))

    def remove(self, name):
        hostport.store_remove(name)

    def sync(self):
        hostport.store_sync()


def estimator_of(board):
    """The part that makes estimates; it can be flashed if the emulator was given a public key."""
    key = bytes([hostport.key_byte(i) for i in range(KEY_BYTES) if hostport.key_byte(i) >= 0])
    return estimator.Estimator(board.store, flash.Flash(board.store, key) if key else None)


class EmulatedBoard:
    """See firmware_py/boards/__init__.py for what each member does."""

    def __init__(self):
        self.store = HostStore()
        self.serial = bytes([hostport.serial_byte(i) for i in range(8)])
        self.boots = hostport.boots()
        self.settings_record = safe_record.Record(self.store, "set")
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

    def start_scan(self):
        pass

    def scanned(self):
        return True

    def scan(self, counts):
        _scan(addressof(counts))

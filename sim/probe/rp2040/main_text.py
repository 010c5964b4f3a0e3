"""The board's `main.py`: puts the modules within reach of `import` and starts the probe.

A start that hangs is ended by the watchdog. One that fails tells the host why, in a packet made here, as no
module can be relied on then; after eight seconds the watchdog has it try again.
"""

MAIN_TEXT = '''"""Starts the probe. Its modules lie in one file: from a directory each would take longer."""

import micropython

micropython.kbd_intr(-1)  # a host's first bytes may hold a 3, which is no Ctrl-C here
import machine

machine.WDT(timeout=8000)
import binascii
import io
import os
import struct
import sys
import time

import rp2

PACK = "firmware.pack"


class Pack:
    """For `import`: CRC-32 of the rest, length of the index, index, files.

    The index has for each a line feed, name, 0, place and size.
    """

    def __init__(self, name):
        self.name = name
        self.file = open(name, "rb")
        said = self.file.read(4)
        piece = memoryview(bytearray(4096))
        crc = 0
        n = self.file.readinto(piece)
        while n:
            crc = binascii.crc32(piece[:n], crc)
            n = self.file.readinto(piece)
        if crc.to_bytes(4, "little") != said:
            raise ValueError(name + " is damaged: copy it onto the probe again")
        self.look()

    def look(self):
        self.file.seek(4)
        n = int.from_bytes(self.file.read(4), "little")
        self.index = self.file.read(n)
        self.first = 8 + n

    def rest(self):
        """Give the memory back, 3 kB, until the next import."""
        self.file.close()
        self.file = self.index = None

    def mount(self, readonly, mkfs):
        pass

    def umount(self):
        pass

    def find(self, path):
        if path[:12] != "firmware_py/" or path[-4:] != ".mpy":
            return None
        if not self.index:
            self.file = open(self.name, "rb")
            self.look()
        name = b"\\n" + path[12:-4].encode() + b"\\0"  # no more than is needed: to seek it takes time
        at = self.index.find(name)
        return struct.unpack_from("<II", self.index, at + len(name)) if at >= 0 else None

    def stat(self, path):
        path = path[1 if path[0] == "/" else 0 :]
        found = self.find(path)
        if found:
            return (0x8000, 0, 0, 0, 0, 0, found[1], 0, 0, 0)
        if path in ("firmware_py", "firmware_py/boards"):
            return (0x4000, 0, 0, 0, 0, 0, 0, 0, 0, 0)
        raise OSError(2)

    def open(self, path, mode):
        place, size = self.find(path[1 if path[0] == "/" else 0 :])
        self.file.seek(self.first + place)
        return io.BytesIO(self.file.read(size))


def tell(link, text):
    """An error for the host's log."""
    body = struct.pack("<BBI", {LOG}, 2, time.ticks_us() & 0x3FFFFFFF) + text.encode()[:200]
    body += binascii.crc32(body).to_bytes(4, "little")
    runs = [bytes((len(run) + 1,)) + run for run in body.split(b"\\0")]
    link.write(b"\\0" + b"".join(runs) + b"\\0")


def failed(error):
    """Tell the host why, until the watchdog has the probe try again; True for somebody at BOOTSEL."""
    link = {LINK}
    for _ in range(20):
        if rp2.bootsel_button():
            return True
        tell(link, "the probe does not start: %s: %s" % (type(error).__name__, error))
        time.sleep(1)
    return False


def prompt():
    """Leave to MicroPython's prompt: its watchdog's ENABLE is cleared (RP2040 data sheet, 4.7.6)."""
    machine.mem32[0x400DB000 if "RP2350" in sys.implementation._machine else 0x4005B000] = 1 << 30
    micropython.kbd_intr(3)


try:
    if PACK in os.listdir():  # not where the firmware is frozen
        pack = Pack(PACK)
        os.mount(pack, "/f")
        sys.path.insert(0, "/f")  # a path that each module keeps: short
        from firmware_py import memory

        memory.loaded = pack.rest
    from firmware_py.boards import rp2_reference

    rp2_reference.main(uart={UART})
    prompt()
except Exception as error:
    if failed(error):
        prompt()
'''


def main_text(uart: bool, log: int) -> str:
    """The file's text.

    Parameters: whether the host is on the UART, and a log message's type.
    """
    link = "machine.UART(0, 921600)" if uart else "sys.stdout.buffer"
    return MAIN_TEXT.replace("{LINK}", link).replace("{UART}", str(uart)).replace("{LOG}", f"{log:#x}")

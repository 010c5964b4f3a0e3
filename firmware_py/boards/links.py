"""The wire to the host: USB's serial port, or a UART.

Neither ever waits, and bytes 3 and 4 are only bytes.
"""

import select
import sys

import micropython
from machine import UART

_PIECE = 64  # a USB packet; what the port takes at once when it says that it can take something


class UsbLink:
    """The USB serial port that MicroPython otherwise keeps for its prompt."""

    def __init__(self) -> None:
        micropython.kbd_intr(-1)
        self._in = sys.stdin.buffer
        self._out = sys.stdout.buffer
        self._readable = select.poll()
        self._readable.register(sys.stdin, select.POLLIN)
        self._writable = select.poll()
        self._writable.register(sys.stdout, select.POLLOUT)
        self._byte = bytearray(1)

    def _ready(self, poll: "select.poll") -> bool:
        for _ in poll.ipoll(0):
            return True
        return False

    def read(self, buffer: bytearray) -> int:
        """What is there, into buffer; how many bytes."""
        n = 0
        one = self._byte
        while n < len(buffer) and self._ready(self._readable):
            if not self._in.readinto(one):
                break
            buffer[n] = one[0]
            n += 1
        return n

    def write(self, buffer: bytearray, start: int, stop: int) -> int:
        """As much of buffer[start:stop] as the port takes now; how many bytes."""
        at = start
        while at < stop and self._ready(self._writable):
            n = stop - at
            if n > _PIECE:
                n = _PIECE
            # write(buffer, offset, length) is MicroPython's own: a slice would allocate
            n = self._out.write(buffer, at, n) or 0  # type: ignore[call-arg]
            if n <= 0:
                break
            at += n
        return at - start


class UartLink:
    """A UART; give it buffers (txbuf, rxbuf) and timeout=0 when it is made."""

    def __init__(self, uart: UART) -> None:
        self._uart = uart

    def read(self, buffer: bytearray) -> int:
        """What is there, into buffer; how many bytes."""
        if not self._uart.any():
            return 0
        return self._uart.readinto(buffer) or 0

    def write(self, buffer: bytearray, start: int, stop: int) -> int:
        """As much of buffer[start:stop] as fits into the UART's own buffer; how many bytes."""
        return self._uart.write(buffer, start, stop - start) or 0  # type: ignore[call-arg]

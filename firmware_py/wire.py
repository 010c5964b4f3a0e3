"""The packet layer: body + CRC-32, stuffed by COBS, closed by a zero byte; the same file at both ends.

    wire packet = COBS(body, CRC-32 of body as 4 bytes, least significant first), 0x00

Empty packets (zero after zero) mean nothing, so a sender may put a zero before a packet to end whatever noise
stands in front of it. A damaged packet is dropped and counted; the next zero starts afresh, so that damage
costs the packet it hits and, where it ate the zero, the one behind it: never more.
"""

import sys

from firmware_py import cobs, crc

_BLOCKS = sys.implementation.name == "cpython"


def wire_size(n):
    """Bytes on the wire that a body of n bytes takes at most, with a zero before and behind it."""
    return cobs.worst_case(n + crc.SIZE) + 1


def seal(body, n, target, at):
    """Append the CRC to body[:n] (it needs 4 bytes more room) and encode into target[at:]; return the end."""
    return cobs.encode(body, crc.append(body, n), target, at)


class Receiver:
    """Cuts a byte stream into checked packets. Its only memory is one buffer; feeding it allocates nothing.

    Parameters: size, the longest body (bytes) that will be accepted.
    Use:
        at = 0
        while at < n:
            at = receiver.feed(data, at, n)
            if receiver.length:
                use(receiver.packet, receiver.length)   # before the next feed
    Counters: `packets` accepted, `bad_crc`, `bad_frame` (impossible COBS), `oversize`.
    """

    def __init__(self, size):
        self.packet = bytearray(cobs.worst_case(size + crc.SIZE))
        self.length = 0
        self.packets = 0
        self.bad_crc = 0
        self.bad_frame = 0
        self.oversize = 0
        self._have = 0
        self._skip = False

    def reset(self):
        """Forget a half-received packet (after a reconnect)."""
        self.length = 0
        self._have = 0
        self._skip = False

    def _close(self):
        n = self._have
        self._have = 0
        if self._skip:
            self._skip = False
            self.oversize += 1
            return
        if n == 0:
            return
        n = cobs.decode(self.packet, n)
        if n < 0:
            self.bad_frame += 1
        elif n <= crc.SIZE or not crc.check(self.packet, n):
            self.bad_crc += 1
        else:
            self.packets += 1
            self.length = n - crc.SIZE

    def _feed_bytes(self, data, at, stop):
        """Take data[at:stop] up to the end of one packet; return the index behind what was taken."""
        self.length = 0
        packet = self.packet
        room = len(packet) - 1
        have = self._have
        while at < stop:
            byte = data[at]
            at += 1
            if byte == 0:
                self._have = have
                self._close()
                have = 0
                if self.length:
                    return at
            elif have < room:
                packet[have] = byte
                have += 1
            else:
                self._skip = True
        self._have = have
        return at

    def _feed_blocks(self, data, at, stop):
        """`_feed_bytes` by slices, for CPython: data is bytes or bytearray."""
        self.length = 0
        room = len(self.packet) - 1
        while at < stop:
            end = data.find(0, at, stop)
            take = stop if end < 0 else end
            have = self._have
            n = take - at
            if have + n > room:
                self._skip = True
                n = room - have
            self.packet[have : have + n] = data[at : at + n]
            self._have = have + n
            at = take
            if end >= 0:
                at += 1
                self._close()
                if self.length:
                    return at
        return at

    feed = _feed_blocks if _BLOCKS else _feed_bytes

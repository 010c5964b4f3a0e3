"""What the probe counts, modulo 2**30; the order is that of messages.COUNTERS."""

from array import array

from firmware_py import messages

MASK = messages.WRAP - 1

UPTIME_MS = 0
FRAMES_ACQUIRED = 1
FRAMES_SENT = 2
FRAMES_DROPPED = 3
FRAMES_OVERRUN = 4
MESSAGES_SENT = 5
RESULTS_RESENT = 6
COMMANDS = 7
COMMANDS_DUPLICATE = 8
COMMANDS_REFUSED = 9
PACKETS_BAD_CRC = 10
PACKETS_BAD_FRAME = 11
PACKETS_OVERSIZE = 12
BYTES_RECEIVED = 13
BYTES_SENT = 14
STROKES = 15
ESTIMATES = 16
FREE_BYTES = 17
EVENTS_DROPPED = 18
ESTIMATES_ACKNOWLEDGED = 19
ESTIMATES_GIVEN_UP = 20
ESTIMATES_WAITING = 21
MAPS_GIVEN_UP = 22
LEASES_EXPIRED = 23


_COUNT = len(messages.COUNTERS)


def fresh():
    """All counters at zero."""
    return array("i", [0] * _COUNT)


def add(counters, which, n):
    """Add n, without allocating."""
    counters[which] = (counters[which] + n) & MASK


def elapsed(later, earlier):
    """Difference of two wrapping numbers, between -2**29 and 2**29 - 1; every intermediate is a small int."""
    d = (later - earlier) & MASK
    return d if d < 0x20000000 else d - 0x40000000

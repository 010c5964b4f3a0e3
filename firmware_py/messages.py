"""Every message of the wire, packed and unpacked by the tables; both ends use it. docs/protocol.md explains.

A body is  type (1 byte)                               for what the probe sends unasked,
           type, id (2)                                for a command,
           type | 0x80, id (2), status (1, signed)     for its answer,
followed by the fields of `tables`, little-endian, without padding. Numbers that grow forever (sequence,
time_us, counters) count modulo 2**30, so that a 32-bit MicroPython holds them without allocating.
"""

import struct

from firmware_py import geometry, tables

# users of this module find all tables here
COMMANDS = tables.COMMANDS
ANSWERS = tables.ANSWERS
EVENTS = tables.EVENTS
SETTINGS = tables.SETTINGS
COUNTERS = tables.COUNTERS
PROTOCOL = tables.PROTOCOL
SCHEMA = tables.SCHEMA

ORDERED = tables.ORDERED

WRAP = 1 << 30  # modulus of sequence numbers, device time and counters
COMMAND_WIRE = 64  # a command's longest wire form, its zeros before and behind included
COMMAND_BODY = COMMAND_WIRE - 7  # what CRC (4), COBS (1) and two zeros leave for type, id and fields
FLASH_PIECE = 48  # bytes of a model image in one flash_data

ANSWER = 0x80

# what a stream carries (stream_start.content, bits)
CONTENT_FRAMES = 1
CONTENT_STROKES = 2  # stroke states, maps and estimates

# a stream ends by itself when no command has come for so long (stream_start.lease_ms, 0: the usual)
LEASE_MS = 10000
LEASE_LEAST_MS = 500
LEASE_MOST_MS = 300000

# stream_end.reason
END_STROKES = 1  # as many strokes as were asked for
END_LEASE = 2  # nobody renewed it
ENDS = {END_STROKES: "strokes", END_LEASE: "lease"}

# what the probe found damaged in its store (identify.damage, estimate.damage, bits)
DAMAGED_CALIBRATION = 1
DAMAGED_MODEL = 2
DAMAGED_SETTINGS = 4
DAMAGE_REPAIRED = 8  # a copy of something was damaged, the other whole: nothing is lost
DAMAGE_TRIAL_HUNG = 16  # the probe restarted while it tried a model; the one that it had stays

# capabilities (identify, bits)
CAN_FLASH = 1
CAN_CALIBRATE = 2
TAKES_REFERENCE = 8  # the live model does
HOLDS_REFERENCE = 16  # a reference press of this visit

CALIBRATE_ZERO = 0
CALIBRATE_GAIN = 1
CALIBRATE_CLEAR = 2

REFERENCE_TAKE = 0  # reference.kind: wait for a press; answered when it is over
REFERENCE_CLEAR = 1
REFERENCE_TELL = 2

# stroke_state.state; value is the image's sum (Pa, mean over the cells) unless said otherwise
STATE_CONTACT = 1
STATE_STARTED = 2
STATE_LUMP_PASSED = 3  # value: position_um of the lump's centre
STATE_ENDED = 4  # value: frames in the stroke
STATE_FORCE_LOW = 5
STATE_FORCE_HIGH = 6
STATE_TOO_FAST = 7  # value: speed, um/s
STATE_LIFTED = 8
STATES = {
    STATE_CONTACT: "contact",
    STATE_STARTED: "started",
    STATE_LUMP_PASSED: "lump_passed",
    STATE_ENDED: "ended",
    STATE_FORCE_LOW: "force_low",
    STATE_FORCE_HIGH: "force_high",
    STATE_TOO_FAST: "too_fast",
    STATE_LIFTED: "lifted",
}

HAVE_MAP = 1  # stroke_ack.have (bits)
HAVE_FEATURES = 2
HAVE_ESTIMATE = 4
HAVE_ALL = 7

READ_CALIBRATION = 0  # read_back.what: the stored bytes, so that a host can replay the probe's integers
READ_MODEL = 1
READ_PIECE = 200  # bytes of it in one answer, at most

LOG_INFO = 0
LOG_WARNING = 1
LOG_ERROR = 2


def _table():
    table = {}
    for definition in COMMANDS + ANSWERS + EVENTS:
        table[definition[0]] = definition
    return table


TABLE = _table()
# type -> its fields for `struct`, its tail: all that is needed to pack it
FORMATS = {d[0]: ("<" + d[2], d[4]) for d in COMMANDS + ANSWERS + EVENTS}
TYPE = {d[1]: d[0] for d in COMMANDS + EVENTS}


def head_size(kind):
    """Bytes before the fields: type, and for commands id, and for answers id and status."""
    if kind & ANSWER:
        return 4
    return 1 if kind & 0x40 else 3


def size(kind, tail):
    """Bytes of an event with so many numbers behind its fields."""
    return head_size(kind) + struct.calcsize(FORMATS[kind][0]) + 4 * tail


def pack(body, kind, message_id, status, values, tail=b""):
    """Write a message into body (a bytearray); return its length.

    kind: type byte; message_id: of the command (ignored for events); status: of an answer (else ignored);
    values: the fields, in order; tail: bytes, or ints where the table says so. ValueError if too long.
    """
    fields, tail_kind = FORMATS[kind]
    body[0] = kind
    at = head_size(kind)
    if at > 1:
        body[1] = message_id & 255
        body[2] = message_id >> 8
    if at > 3:
        body[3] = status & 255
        if status < 0:
            return at
    n = struct.calcsize(fields)
    if tail_kind == "i":
        size = n + 4 * len(tail)
    else:
        size = n + len(tail)
    if at + size > len(body):
        raise ValueError("message too long")
    struct.pack_into(fields, body, at, *values)
    at += n
    if tail_kind == "i":
        for value in tail:
            struct.pack_into("<i", body, at, value)
            at += 4
    else:
        for byte in tail:
            body[at] = byte
            at += 1
    return at


def message_id(body):
    """The id of a command or answer."""
    return body[1] | body[2] << 8


def answer_status(body):
    """The status of an answer, one of firmware_py.status."""
    return body[3] - 256 if body[3] > 127 else body[3]


def unpack(body, length):
    """The fields of body[:length] as a tuple (its tail, bytes or a tuple of ints, last), or None.

    None means: not a message of this table, or not of its length. The fields of a refused command
    (an answer with a negative status) are (). What a newer end has added behind the fields of an answer or
    event is passed over; what an older one does not have yet is 0.
    """
    if length < 1:
        return None
    kind = body[0]
    known = FORMATS.get(kind)
    if known is None:
        return None
    fields, tail = known
    at = head_size(kind)
    if length < at:
        return None
    if kind & ANSWER and answer_status(body) < 0:
        return ()
    n = struct.calcsize(fields)
    left = length - at - n
    if left < 0 and not tail and -left <= tables.ADDED.get(kind, 0):
        body = bytes(body[:length]) + bytes(-left)
    elif left < 0 or (left and not tail and not kind & 0xC0) or (tail == "i" and left % 4):
        return None
    values = struct.unpack_from(fields, body, at)
    if tail == "B":
        return values + (bytes(body[at + n : length]),)
    if tail == "i":
        return values + (struct.unpack_from("<%di" % (left // 4), body, at + n),)
    return values


_MORE = 17  # where the fields of FRAME_MORE begin
FRAME_HEAD = _MORE + 4 * len(tables.FRAME_MORE)  # bytes before the packed counts of a frame
FRAME_BODY = FRAME_HEAD + geometry.FRAME_BYTES


def put_int(body, at, value):
    """Write a signed number of |value| < 2**30 as four bytes, least significant first, without allocating."""
    body[at] = value & 255
    body[at + 1] = value >> 8 & 255
    body[at + 2] = value >> 16 & 255
    body[at + 3] = value >> 24 & 255


def put_frame_head(body, seq, time_us, position_um, displacement_um):
    """Write all of a frame but its counts, which belong at body[FRAME_HEAD:], without allocating."""
    body[0] = 0x40
    put_int(body, 1, seq)
    put_int(body, 5, time_us)
    put_int(body, 9, position_um)
    put_int(body, 13, displacement_um)


def put_frame_more(body, k, value):
    """Write the k-th of `tables.FRAME_MORE`, without allocating."""
    put_int(body, _MORE + 4 * k, value)

"""In which order the reference board measures its matrix, and back to rows and columns.

Rows and columns are walked in Gray order, so that one address pin changes from one cell to the next and no
third cell is touched on the way.
"""

from array import array

from firmware_py import geometry

ROWS = geometry.ROWS
COLUMNS = geometry.COLUMNS
CELLS = geometry.CELLS
ON_A = 16  # columns on multiplexer A, channel 0; the other ten are on B, channel 1
DISPLACEMENT = 2  # its channel
READINGS = 2  # of it, before the cells
CONVERSIONS = READINGS + CELLS
ADDRESS_BITS = 8  # row in bits 0 to 3, column in bits 4 to 7
_DIN = 1 << ADDRESS_BITS


def order(channel, here, following):
    """The word for one conversion: of `channel`, at address `here`; `following` is the one after it."""
    d1 = here | (_DIN if channel & 2 else 0)
    d0 = here | (_DIN if channel & 1 else 0)
    return d1 | d0 << ADDRESS_BITS + 1 | following << 2 * (ADDRESS_BITS + 1)


def walk():
    """In the order of measuring: channel, address (row | column << 4) and the cell's place, or -1."""
    for _ in range(READINGS):
        yield DISPLACEMENT, 0, -1
    for i in range(ROWS):
        row = i ^ i >> 1
        for k in range(16):
            column = k ^ k >> 1
            address = row | column << 4
            yield 0, address, row * COLUMNS + column
            if column < COLUMNS - ON_A:
                yield 1, address, row * COLUMNS + ON_A + column


def tables():
    """The state machine's words (`order` along the `walk`), and for each cell the number of its conversion.

    Written out, as calls cost a board ten times the time: it makes them at every start.
    """
    orders = array("I", bytes(4 * CONVERSIONS))
    places = array("H", bytes(2 * CELLS))
    for n in range(READINGS):
        orders[n] = order(DISPLACEMENT, 0, 0)
    n = READINGS
    for i in range(ROWS):
        row = i ^ i >> 1
        cell = row * COLUMNS
        for k in range(16):
            column = k ^ k >> 1
            address = row | column << 4
            word = address | address << ADDRESS_BITS + 1  # of channel 0; the address after it comes later
            orders[n - 1] |= address << 2 * (ADDRESS_BITS + 1)
            orders[n] = word
            places[cell + column] = n
            n += 1
            if column < COLUMNS - ON_A:
                orders[n - 1] |= address << 2 * (ADDRESS_BITS + 1)
                orders[n] = word | _DIN << ADDRESS_BITS + 1
                places[cell + ON_A + column] = n
                n += 1
    return orders, places


def pack(raw, places, counts):
    """Conversions in the order of measuring to cells in the order of the frame, two counts in three bytes."""
    at = 0
    for i in range(0, CELLS, 2):
        v = raw[places[i]]
        w = raw[places[i + 1]]
        counts[at] = v & 255
        counts[at + 1] = v >> 8 | (w & 15) << 4
        counts[at + 2] = w >> 4
        at += 3

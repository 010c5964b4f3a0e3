"""The sensor matrix and the displacement, measured in the background by a state machine and two DMA channels.

One multiplexer drives a row, two choose the column for two channels of the converter; the displacement is on
a third. Allocates nothing once it is made.
"""

from array import array

import rp2
from machine import Pin

from firmware_py.boards import mcp3204, scan_order

CELLS = scan_order.CELLS
READINGS = scan_order.READINGS
CONVERSIONS = scan_order.CONVERSIONS
_MACHINE = 4  # the first of PIO block 1; the encoder's program fills block 0
_SEND = 8  # DMA request: that machine's queue has room
_RECEIVE = 12  # and: it holds something


class Scan:
    """Measures all cells and the displacement.

    Parameters
    address: the first of nine neighbouring pins: row (4), column (4), the converter's DIN
    select: the chip select; the clock's pin is the next one
    dout, din: the converter's data pins
    """

    def __init__(self, address: Pin, select: Pin, dout: Pin, din: Pin) -> None:
        self._orders, self._places = scan_order.tables()
        self._raw = array("H", bytes(2 * CONVERSIONS))
        self._machine = rp2.StateMachine(
            _MACHINE,
            mcp3204.conversions,
            freq=mcp3204.MACHINE_HZ,
            in_base=dout,
            out_base=address,
            set_base=din,
            sideset_base=select,
        )
        self._send = rp2.DMA()
        self._receive = rp2.DMA()
        self._send.config(
            write=self._machine,
            count=CONVERSIONS,
            ctrl=self._send.pack_ctrl(size=2, inc_read=True, inc_write=False, treq_sel=_SEND),
        )
        self._receive.config(
            read=self._machine,
            count=CONVERSIONS,
            ctrl=self._receive.pack_ctrl(size=1, inc_read=False, inc_write=True, treq_sel=_RECEIVE),
        )
        self._machine.active(1)

    def start(self) -> None:
        """Begin a scan; one that is under way is waited for (at most 9 ms)."""
        while self._receive.active():
            pass
        self._receive.config(write=self._raw, count=CONVERSIONS, trigger=True)
        self._send.config(read=self._orders, count=CONVERSIONS, trigger=True)

    def done(self) -> bool:
        """True if no scan is under way: what was measured can be taken."""
        return not self._receive.active()

    def take(self, counts: "memoryview | bytearray") -> None:
        """The cells, into 624 bytes: rows along the stroke one after the other, two cells in three bytes."""
        scan_order.pack(self._raw, self._places, counts)

    def displacement(self) -> int:
        """The displacement's counts, the sum of `READINGS`."""
        total = 0
        for i in range(READINGS):
            total += self._raw[i]
        return total

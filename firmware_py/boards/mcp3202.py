"""Microchip MCP3202: two channels of 12 bits on SPI (data sheet DS21034F, section 5 "Serial communications").

24 clocks a conversion, the chip selected throughout; at 3.3 V at most 1.2 MHz. Allocates nothing.
"""

from machine import SPI, Pin

# start bit; then single-ended, channel, most significant bit first
_CHANNEL_0 = b"\x01\xa0\x00"
_CHANNEL_1 = b"\x01\xe0\x00"


class MCP3202:
    """One chip on a bus (SPI mode 0) with its own select pin."""

    def __init__(self, spi: SPI, select: Pin) -> None:
        self._spi = spi
        self._select = select.value
        self._reply = bytearray(3)
        select.value(1)

    def read(self, channel: int) -> int:
        """One conversion of channel 0 or 1: 0 to 4095."""
        reply = self._reply
        select = self._select
        select(0)
        self._spi.write_readinto(_CHANNEL_1 if channel else _CHANNEL_0, reply)
        select(1)
        return (reply[1] & 15) << 8 | reply[2]

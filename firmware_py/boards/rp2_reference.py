"""The reference probe on a Raspberry Pi Pico (RP2040) or Pico 2 (RP2350); docs/firmware.md has the wiring.

`main.py` on the board holds two lines:

    from firmware_py.boards import rp2_reference
    rp2_reference.main()
"""

import time

import machine
import rp2
from machine import SPI, UART, Pin

from firmware_py import counters, estimator, flash, probe, record, store
from firmware_py.boards import encoder, links, machine_code, matrix, mcp3202, pio_encoder

ROW_PINS = (2, 3, 4, 5)
COLUMN_PINS = (6, 7, 8, 9)
ENCODER_PINS = (10, 11)
ADC_SCK, ADC_MOSI, ADC_MISO = 18, 19, 16
MATRIX_SELECT = 17
DISPLACEMENT_SELECT = 20
LED = "LED"
UART_BAUD = 921600

ADC_HZ = 1000000  # the MCP3202 takes .9 MHz at 2.7 V and 1.8 at 5 V
ENCODER_UM = (25, 1)  # a quarter step: a wheel of 40 mm circumference, 400 cycles a turn
DISPLACEMENT_UM = 25000  # the potentiometer's travel
DISPLACEMENT_READINGS = 4
KEY_FILE = "key.pub"


class Board:
    """See firmware_py/boards/__init__.py.

    Parameters: link (links.UsbLink or links.UartLink), spi, and root, the directory of the store.
    """

    def __init__(self, link: "links.UsbLink | links.UartLink", spi: SPI, root: str = "") -> None:
        self.read = link.read
        self.write = link.write
        self.store = store.FileStore(root)
        self.serial = bytes(machine.unique_id() + bytes(8))[:8]
        self.boots = self._count_boot()
        self._settings = record.Record(self.store, "set")
        self._matrix = matrix.Matrix(
            mcp3202.MCP3202(spi, Pin(MATRIX_SELECT, Pin.OUT, value=1)),
            tuple([Pin(n, Pin.OUT) for n in ROW_PINS]),
            tuple([Pin(n, Pin.OUT) for n in COLUMN_PINS]),
        )
        self._displacement = mcp3202.MCP3202(spi, Pin(DISPLACEMENT_SELECT, Pin.OUT, value=1))
        self._encoder = make_encoder()
        self._led = Pin(LED, Pin.OUT, value=0)
        self.scan = self._matrix.scan
        self.position_um = self._encoder.position_um

    def _count_boot(self) -> int:
        boots = record.Record(self.store, "boot")
        kept = boots.load()
        number = (int.from_bytes(kept, "little") + 1 if kept else 1) & counters.MASK
        boots.save(number.to_bytes(4, "little"))
        return number

    def ticks_us(self) -> int:
        """Device time; the port's own period is 2**30 us."""
        return time.ticks_us()  # type: ignore[return-value]  # an int to everyone but the stubs

    def idle(self, us: int) -> None:
        """A short sleep: the link cannot wake it."""
        if us > 0:
            time.sleep_us(us if us < 500 else 500)

    def begin(self) -> None:
        """A stream starts."""
        self._led.value(1)

    def end(self) -> None:
        """It stops."""
        self._led.value(0)

    def displacement_um(self) -> int:
        """The potentiometer, mean of a few readings; allocates nothing."""
        total = 0
        for _ in range(DISPLACEMENT_READINGS):
            total += self._displacement.read(0)
        return total * DISPLACEMENT_UM // (4095 * DISPLACEMENT_READINGS)

    def kept_settings(self) -> "bytes | None":
        """What `keep_settings` kept."""
        return self._settings.load()

    def keep_settings(self, data: bytes) -> int:
        """Keep the settings; a status."""
        return self._settings.save(data)


def make_encoder() -> "pio_encoder.PioEncoder | encoder.Encoder":
    """The wheel, counted by PIO block 0; by the pins' interrupts where that has no room (OSError)."""
    a, b = [Pin(n, Pin.IN, Pin.PULL_UP) for n in ENCODER_PINS]
    try:
        return pio_encoder.PioEncoder(a, b, ENCODER_UM[0], ENCODER_UM[1])
    except OSError:
        return encoder.Encoder(a, b, ENCODER_UM[0], ENCODER_UM[1])


def make(link: "links.UsbLink | links.UartLink") -> "tuple[Board, estimator.Estimator]":
    """The board and what makes its estimates; it can be flashed if the public key is in the file key.pub."""
    spi = SPI(0, baudrate=ADC_HZ, sck=Pin(ADC_SCK), mosi=Pin(ADC_MOSI), miso=Pin(ADC_MISO))
    board = Board(link, spi)
    key = board.store.read(KEY_FILE, 0, 64)
    return board, estimator.Estimator(board.store, flash.Flash(board.store, key) if key else None)


def main(uart: bool = False) -> None:
    """Serve for ever, on USB or on UART 0 (GP0, GP1). With BOOTSEL held, return to MicroPython's prompt."""
    if rp2.bootsel_button():
        return
    note = machine_code.install()
    link: "links.UsbLink | links.UartLink"
    if uart:
        link = links.UartLink(UART(0, UART_BAUD, tx=Pin(0), rx=Pin(1), txbuf=2048, rxbuf=256, timeout=0))
    else:
        link = links.UsbLink()
    board, estimates = make(link)
    probe.run(board, estimates, note)

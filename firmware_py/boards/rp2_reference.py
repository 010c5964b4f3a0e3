"""The reference probe on a Raspberry Pi Pico (RP2040) or Pico 2 (RP2350); docs/firmware.md has the wiring.

`main.py` on the board (`palpate board` writes it):

    import micropython
    micropython.kbd_intr(-1)
    from firmware_py.boards import rp2_reference
    rp2_reference.main()

Without its second line a byte 3 from the host, while the modules are loaded, ends it at MicroPython's prompt.
"""

from firmware_py import memory

memory.reserve()  # the largest block first: there is no room for it between modules

import gc  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402

import machine  # noqa: E402
import micropython  # noqa: E402
import rp2  # noqa: E402
from machine import UART, WDT, Pin  # noqa: E402

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterator

gc.threshold(40960)  # what loading modules leaves behind is cleared away before the next one is put there

from firmware_py import (  # noqa: E402
    counters,
    estimator,
    flash,
    geometry,
    messages,
    probe,
    safe_record,
    status,
    store,
    wire,
)
from firmware_py.boards import links, pio_encoder, scan  # noqa: E402

ADDRESS_PIN = 2  # GP2 to GP5: row; GP6 to GP9: column
DIN_PIN = 10
ENCODER_PINS = (11, 12)
DOUT_PIN = 16
SELECT_PIN = 17  # the converter's clock is the next one, GP18
LED = "LED"
UART_BAUD = 921600

ENCODER_UM = (25, 1)  # a quarter step: a wheel of 40 mm circumference, 400 cycles a turn
DISPLACEMENT_UM = 25000  # the potentiometer's travel
KEY_FILE = "key.pub"
WATCHDOG_MS = 8000  # the longest work, checking a new model, takes a quarter of it


class Board:
    """See firmware_py/boards/__init__.py.

    Parameters: link (links.UsbLink or links.UartLink), and root, the directory of the store.
    """

    def __init__(self, link: "links.UsbLink | links.UartLink", root: str = "") -> None:
        self.read = link.read
        self.write = link.write
        self.store = store.FileStore(root)
        self.serial = bytes(machine.unique_id() + bytes(8))[:8]
        self.boots = self._count_boot()
        self.settings_record = safe_record.Record(self.store, "set")
        self._scan = scan.Scan(Pin(ADDRESS_PIN), Pin(SELECT_PIN), Pin(DOUT_PIN, Pin.IN), Pin(DIN_PIN))
        a, b = [Pin(n, Pin.IN, Pin.PULL_UP) for n in ENCODER_PINS]
        self._encoder = pio_encoder.best(a, b, ENCODER_UM[0], ENCODER_UM[1])
        self._led = Pin(LED, Pin.OUT, value=0)
        self._dog: "WDT | None" = None
        self.start_scan = self._scan.start
        self.scanned = self._scan.done
        self.scan = self._scan.take
        self.position_um = self._encoder.position_um

    def watch(self) -> None:
        """From now on a hang ends in a restart."""
        self._dog = WDT(timeout=WATCHDOG_MS)

    def _count_boot(self) -> int:
        boots = safe_record.Record(self.store, "boot")
        kept = boots.load()
        number = (int.from_bytes(kept, "little") + 1 if kept else 1) & counters.MASK
        boots.save(number.to_bytes(4, "little"))
        return number

    def ticks_us(self) -> int:
        """Device time; the port's own period is 2**30 us."""
        return time.ticks_us()  # type: ignore[return-value]  # an int to everyone but the stubs

    def idle(self, us: int) -> None:
        """A short sleep: the link cannot wake it. Whoever calls this does not hang."""
        if self._dog:
            self._dog.feed()
        if us > 0:
            time.sleep_us(us if us < 500 else 500)

    def begin(self) -> None:
        """A stream starts, and what was done before it is cleared away."""
        gc.collect()
        self._led.value(1)

    def end(self) -> None:
        """It stops."""
        self._led.value(0)
        gc.collect()

    def displacement_um(self) -> int:
        """The potentiometer at the beginning of the last scan; allocates nothing."""
        return self._scan.displacement() * DISPLACEMENT_UM // (geometry.FULL_COUNT * scan.READINGS)


def say(link: "links.UsbLink | links.UartLink", text: str) -> None:
    """Tell the host something before there is a probe to tell it; what the link does not take is left out."""
    body = bytearray(len(text) + 16)
    n = messages.pack(body, messages.TYPE["log"], 0, 0, (messages.LOG_INFO, time.ticks_us()), text.encode())
    packet = bytearray(wire.wire_size(n))
    link.write(packet, 0, wire.seal(body, n, packet, 1))


def make(link: "links.UsbLink | links.UartLink") -> "tuple[Board, estimator.Estimator]":
    """The board and what makes its estimates; it can be flashed if the public key is in the file key.pub."""
    global say
    board = Board(link)
    del scan.scan_order.tables
    key = board.store.read(KEY_FILE, 0, 64)
    if key:
        say(link, "starting: the model's signature is checked")
    del say  # its place is free when the model is loaded
    estimates = estimator.Estimator(board.store, flash.Flash(board.store, key) if key else None)
    if not key:
        estimates.model_status = status.NO_KEY
    return board, estimates


def notes(code: str, estimates: "estimator.Estimator") -> "Iterator[tuple[int, str]]":
    """What the host is told of this start: the machine code, memory, and what is not as it should be.

    Asked for one after the other once the probe is made, so that the memory is what is left then.
    """
    yield messages.LOG_INFO, code
    gc.collect()
    yield messages.LOG_INFO, "memory: %d bytes free" % gc.mem_free()
    if machine.reset_cause() == machine.WDT_RESET:
        hung_s = WATCHDOG_MS // 1000
        yield messages.LOG_ERROR, "the watchdog restarted the probe: it had hung for %d s" % hung_s
    if estimates.model_status == status.NO_KEY:
        yield messages.LOG_WARNING, "no public key: copy the key's public half onto the probe as " + KEY_FILE


def _machine_code() -> str:
    """The loops as machine code; what tries them is taken out again."""
    from firmware_py import boards
    from firmware_py.boards import machine_code

    said = machine_code.install(machine_code.PARTS + (("scan", machine_code.scan_part),))
    del boards.machine_code
    del sys.modules["firmware_py.boards.machine_code"]
    return said


def main(uart: bool = False) -> None:
    """Serve for ever, on USB or on UART 0 (GP0, GP1). With BOOTSEL held, return to MicroPython's prompt."""
    if rp2.bootsel_button():
        micropython.kbd_intr(3)
        return
    global _machine_code, make, notes  # each is called once, and then given back
    code = _machine_code()
    del _machine_code
    gc.threshold(-1)
    link: "links.UsbLink | links.UartLink"
    if uart:
        link = links.UartLink(UART(0, UART_BAUD, tx=Pin(0), rx=Pin(1), txbuf=2048, rxbuf=256, timeout=0))
    else:
        link = links.UsbLink()
        del links.UartLink
    board, estimates = make(link)
    board.watch()
    told = notes(code, estimates)
    del make, notes
    gc.collect()
    probe.run(board, estimates, told)

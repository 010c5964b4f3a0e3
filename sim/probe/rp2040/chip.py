"""An emulated RP2040 with a flash chip, on a clock of its own: started, run for so long, reset, cut off.

    chip = Chip(uf2, flash.image(files), [ReferenceCircuit(matrix, hand)])
    chip.run(until=lambda: chip.connected)
    chip.send(b"..."); chip.run_us(20_000); chip.take()

Everything happens in the caller's thread, cycle by cycle (125 MHz), with no look at the computer's own clock.
The processor, its peripherals and the USB host are the package rp2040py's. What that leaves out is here: the
flash chip's serial number, and the time of the state machines (`pacing`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from rp2040py.device.bootrom import BOOTROM_B1
from rp2040py.device.load_flash import load_uf2
from rp2040py.external import ExternalDevice
from rp2040py.external.bootsel_button import BootselButton
from rp2040py.rp2040 import RP2040
from rp2040py.utils.logging import ConsoleLogger, LogLevel

from palpate.errors import PalpateError
from palpate.sim.probe.rp2040 import flash
from palpate.sim.probe.rp2040.pacing import Pacing
from palpate.sim.probe.rp2040.usb_host import UsbHost

_FLASH_AT = 0x10000000
_READ_UNIQUE_ID = 0x4B
_DUMMY_BYTES = 4
SERIAL = bytes.fromhex("e6613852834f2b2c")


class Dead(PalpateError):
    """The chip did not do in time what it was waited for."""


class Chip:
    """One board with its power on.

    Parameters
    uf2: the interpreter
    files: the file system's blocks (flash.image); None: what the interpreter formats itself
    devices: what is soldered to its pins
    serial: the flash chip's 8 bytes
    """

    def __init__(
        self,
        uf2: Path,
        files: bytes | None = None,
        devices: Iterable[ExternalDevice] = (),
        serial: bytes = SERIAL,
    ) -> None:
        self.mcu: Any = RP2040()
        self._pacing = Pacing(self.mcu)
        self.bootsel = BootselButton()
        for device in (*devices, self.bootsel):
            device.attach(self.mcu)
        self.mcu.load_bootrom(BOOTROM_B1)
        self.mcu.logger = ConsoleLogger(LogLevel.ERROR)
        load_uf2(uf2, self.mcu)
        if files is not None:
            self.mcu.flash[flash.START : flash.START + len(files)] = files
        self._serial = serial
        self._flash: Any = self.mcu.ssi
        self._shift, self._apply = self._flash._shift_byte, self._flash._apply_command
        vars(self._flash).update(_shift_byte=self._shift_byte, _apply_command=self._apply_command)
        self.flash_commands = 0
        self.before_flash: Callable[[bytes], None] = lambda _: None
        """Told each command that changes the flash chip (its code, three bytes of address, data)."""
        self.resets = 0
        self.mcu.watchdog.on_watchdog_trigger = self._watchdog
        self._host = UsbHost(self.mcu.usb_ctrl)
        self.open_port = self._host.open_port
        self.unplug, self.plug = self._host.unplug, self._host.plug
        self.mcu.core.pc = _FLASH_AT

    # -- time

    @property
    def us(self) -> float:
        """Device time since the power came, in us."""
        return self.mcu.clock.micros

    @property
    def cycles(self) -> int:
        """Cycles of the processor since the last reset, those asleep not counted."""
        return self.mcu.core.cycles

    def step(self) -> None:
        """Run on for some milliseconds of the computer's time, or up to a cut of the power."""
        self._pacing.run()

    def run(self, until: Callable[[], bool], limit_us: float = 20e6) -> None:
        """Run until something is so. Raises Dead when it is not after `limit_us` of device time."""
        end = self.us + limit_us
        while not until():
            if self.us > end:
                raise Dead(
                    f"after {limit_us / 1e6:g} s; the chip said last: {bytes(self._host.heard[-300:])!r}"
                )
            self.step()

    def run_us(self, us: float) -> None:
        """Run for so long."""
        end = self.us + us
        self.run(lambda: self.us >= end, 2 * us + 1e6)

    # -- the USB port

    @property
    def connected(self) -> bool:
        """True once the host knows the board's port."""
        return self._host.connected

    def send(self, data: bytes) -> None:
        """The host writes."""
        self._host.send(data)

    @property
    def waiting(self) -> bool:
        """True if something can be taken."""
        return bool(self._host.heard)

    def take(self) -> bytes:
        """What the host has received."""
        data = bytes(self._host.heard)
        self._host.heard.clear()
        return data

    def execute(self, code: str, limit_us: float = 20e6) -> str:
        """What the code prints at MicroPython's prompt. Raises Dead with its traceback."""
        self.take()
        self.send(b"\r\x03\x03\x01")
        self.run(lambda: self._host.heard.endswith(b"raw REPL; CTRL-B to exit\r\n>"), limit_us)
        self.take()
        self.send(code.encode() + b"\x04")
        self.run(lambda: self._host.heard.count(b"\x04") >= 2 and self._host.heard.endswith(b">"), limit_us)
        said, wrong, _ = self.take().removeprefix(b"OK").split(b"\x04")
        if wrong:
            raise Dead(wrong.decode())
        return said.decode().replace("\r\n", "\n")

    # -- flash, reset and power

    def _shift_byte(self, byte: int) -> int:
        answer = self._shift(byte)
        sent = self._flash._tx_buffer
        if sent[0] == _READ_UNIQUE_ID and len(sent) > 1 + _DUMMY_BYTES:
            place = len(sent) - 2 - _DUMMY_BYTES
            return self._serial[place] if place < len(self._serial) else 0
        return answer

    def _apply_command(self) -> None:
        sent = self._flash._tx_buffer
        if sent and sent[0] in flash.CHANGES:
            self.flash_commands += 1
            self.before_flash(bytes(sent))
        self._apply()

    def _watchdog(self) -> None:
        self.resets += 1
        self._pacing.rest(False)
        self.mcu.enter_reset(from_watchdog=True)
        self.mcu.leave_reset()

    def hang(self) -> None:
        """The processor stops where it is, deaf to every interrupt: only a reset helps."""
        self.mcu.core.enabled_interrupts = 0
        self.mcu.core.waiting = True
        self._pacing.rest(True)

    def files(self) -> bytes:
        """The file system's blocks as they are now: what a power cut leaves."""
        return bytes(self.mcu.flash[flash.START : flash.START + flash.BYTES])

"""The host at an emulated board's USB port.

rp2040py's host answers every question of the device for data with an empty packet, at once. A real one says
nothing until it has data; without that, the interrupts of empty packets take five sixths of the processor.
"""

from __future__ import annotations

from typing import Any

from rp2040py.usb.cdc import USBCDC


class UsbHost:
    """A computer with the board's serial port open. `connected` once it knows the board.

    Parameters: the controller (RP2040.usb_ctrl).
    """

    def __init__(self, controller: Any) -> None:
        self._controller = controller
        self._cdc = USBCDC(controller)
        self._answer, self._reset = controller.on_endpoint_read, controller.on_reset
        controller.on_endpoint_read, controller.on_reset = self._asked, self._gone
        self._cdc.on_serial_data = self._heard
        self._cdc.on_device_connected = self._known
        self._out = bytearray()
        self._in = bytearray()
        self._room = 0
        self._away = False
        self.connected = False

    def _known(self) -> None:
        self.connected = True

    def _heard(self, data: bytes | bytearray) -> None:
        if not self._away:
            self._out += data

    def _gone(self) -> None:
        self.connected = False
        self._room = 0
        self._reset()

    def _asked(self, endpoint: int, size: int) -> None:
        if not endpoint or endpoint != self._cdc._out_endpoint:
            self._answer(endpoint, size)
            return
        self._room = size
        self._give()

    def _give(self) -> None:
        if self._room and self._in and not self._away:
            data = bytes(self._in[: self._room])
            del self._in[: self._room]
            self._room = 0
            self._controller.endpoint_read_done(self._cdc._out_endpoint, data)

    def send(self, data: bytes) -> None:
        """Write to the port."""
        self._in += data
        self._give()

    @property
    def heard(self) -> bytearray:
        """What the board has said; the reader removes what it has read."""
        return self._out

    def open_port(self, opened: bool) -> None:
        """A program opens or closes the port (DTR)."""
        self._cdc.set_control_lines(dtr=opened, rts=opened)

    def unplug(self) -> None:
        """The cable is pulled. The board, which has a battery, finds its port closed."""
        self.open_port(False)
        self._away, self.connected = True, False

    def plug(self) -> None:
        """It is put in again: the bus is reset, and the board known once it has answered."""
        self._cdc._on_controller_reset()
        self._in.clear()
        self._room, self._away = 0, False
        self._controller.reset_device()

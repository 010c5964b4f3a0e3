"""Which ports there are, which of them carry a probe, and what a `--port` argument stands for."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from typing import Any

from palpate.errors import LinkError, PortAmbiguous, PortBusy, PortForbidden, PortMissing, VersionMismatch
from palpate.link import emulated
from palpate.link.handshake import shake_hands
from palpate.link.line import Line
from palpate.link.schemes import address_of
from palpate.link.transport import open_transport

BOARDS: dict[tuple[int, int], str] = {
    (0x2E8A, 0x0005): "RP2040/RP2350 with MicroPython",
    (0x2E8A, 0x000C): "Raspberry Pi debug probe",
    (0x0403, 0x6001): "FTDI USB-to-UART",
    (0x10C4, 0xEA60): "CP210x USB-to-UART",
    (0x1A86, 0x7523): "CH340 USB-to-UART",
}
"""USB vendor and product ids behind which a probe may be; `auto` asks only these and emulated ones."""


@dataclass(frozen=True)
class Device:
    """A port, and what is behind it.

    Parameters
    ----------
    port : str
        What `--port` takes.
    kind : str
        "usb", "emulated" or "serial".
    description : str
        The board, or what the system says.
    usb_serial : str
        The USB serial number, which `--port` takes as well; "" where there is none.
    state : str
        "probe", "silent", "busy", "forbidden", "other protocol", or "not asked".
    message : str
        Why it is not ready, as a sentence; else "".
    serial, firmware, model_id : str
        What the probe reported; else "".
    capabilities : tuple of str
        Likewise; see identity.Identity.
    """

    port: str
    kind: str
    description: str
    usb_serial: str = ""
    state: str = "not asked"
    message: str = ""
    serial: str = ""
    firmware: str = ""
    model_id: str = ""
    capabilities: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """The device as `--json` prints it."""
        return asdict(self)


def find(ask: bool = True, baud: int = 921_600) -> list[Device]:
    """Every serial port and emulated probe of this machine.

    Parameters
    ----------
    ask : bool
        Shake hands with those that may be a probe (never with a port of unknown hardware).
    baud : int
        Of UARTs.
    """
    devices = [_from_note(note) for note in emulated.running()]
    devices += sorted(_from_system(), key=lambda device: device.port)
    if not ask:
        return devices
    with ThreadPoolExecutor(max_workers=8) as pool:
        return list(pool.map(lambda d: handshake(d, baud) if may_be_probe(d) else d, devices))


def may_be_probe(device: Device) -> bool:
    """True for emulated probes and known USB ids."""
    return device.kind == "emulated" or device.description in BOARDS.values()


def handshake(device: Device, baud: int = 921_600) -> Device:
    """Ask what is at a port; a fault of one port is never raised."""
    try:
        with closing(Line(open_transport(device.port, baud))) as line:
            who = shake_hands(line)
            return replace(
                device, state="probe", serial=who.serial, firmware=who.firmware, model_id=who.model_id,
                capabilities=who.capabilities,
            )  # fmt: skip
    except PortBusy as error:
        return replace(device, state="busy", message=str(error))
    except PortForbidden as error:
        return replace(device, state="forbidden", message=str(error))
    except VersionMismatch as error:
        return replace(device, state="other protocol", message=str(error))
    except LinkError as error:
        return replace(device, state="silent", message=str(error))


@dataclass(frozen=True)
class Place:
    """Where a probe is, and how to find it again after an unplug.

    Parameters
    ----------
    port : str
        What to open now.
    usb_serial : str
        Finds a USB probe that comes back under another name; "" where the port's name must do.
    pid : int
        The process of an emulated probe, whose pseudo-terminal gets another name; 0 for others.
    """

    port: str
    usb_serial: str = ""
    pid: int = 0

    def port_now(self) -> str:
        """The port's present name; `PortMissing` while the probe is away."""
        if self.pid:
            notes = emulated.running()
            own = [note for note in notes if note.pid == self.pid]
            own = own or [note for note in notes if note.port == self.port]  # it was started again
            if not own:
                raise PortMissing(self.port, f"the emulated probe at {self.port} has ended; start it again")
            return own[0].port
        return resolve(self.usb_serial).port if self.usb_serial else self.port


def resolve(port: str, baud: int = 921_600) -> Place:
    """The port that a `--port` argument stands for.

    Parameters
    ----------
    port : str
        `auto`, a USB or probe's serial number, or a port as it is.
    baud : int
        Of a UART that must be asked.

    Raises
    ------
    PortMissing
        No probe, or none with that serial number.
    PortAmbiguous
        `auto` found several.
    """
    if address_of(port) is not None:
        return Place(port)
    if "/" in port or port.upper().startswith("COM") or "\\" in port:
        return _place(port)
    if port == "auto":
        return _place(_the_only_one(find(baud=baud)).port)
    for device in find(ask=False):
        if device.usb_serial and device.usb_serial.lower() == port.lower():
            return Place(device.port, device.usb_serial)
    for device in find(baud=baud):
        if device.serial and device.serial.lower() == port.lower():
            return _place(device.port)
    raise PortMissing(
        port, f"there is no port and no probe with the serial number {port!r}; `palpate devices` lists both"
    )


def _place(port: str) -> Place:
    pid = next((note.pid for note in emulated.running() if note.port == port), 0)
    usb_serial = next((d.usb_serial for d in _from_system() if d.port == port), "")
    return Place(port, usb_serial, pid)


def _the_only_one(devices: list[Device]) -> Device:
    probes = [device for device in devices if device.state == "probe"]
    if len(probes) == 1:
        return probes[0]
    if probes:
        ports = tuple(device.port for device in probes)
        raise PortAmbiguous(
            "auto", f"there are {len(ports)} probes ({', '.join(ports)}); name one with --port", ports
        )
    for device in devices:
        if device.state == "busy":
            raise PortBusy(device.port, device.message)
        if device.state == "forbidden":
            raise PortForbidden(device.port, device.message)
        if device.state == "other protocol":
            raise LinkError(device.message)
    raise PortMissing(
        "auto",
        "no probe found; plug one in, start one with `palpate emulate d12h07e20f06`, or name it with --port",
    )


def _from_note(note: emulated.Note) -> Device:
    return Device(note.port, "emulated", f"{note.code} on {note.runtime}")


def _from_system() -> list[Device]:
    from serial.tools import list_ports

    found = []
    for info in list_ports.comports():
        known = BOARDS.get((info.vid, info.pid)) if info.vid is not None else None
        description = known or (info.description if info.description != "n/a" else "") or "serial port"
        kind = "usb" if info.vid is not None else "serial"
        found.append(Device(info.device, kind, description, info.serial_number or ""))
    return found

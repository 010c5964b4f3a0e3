"""Bytes to and from a probe: serial ports, pseudo-terminals and TCP, behind one small protocol.

Ports are opened raw (no echo, no newline translation, no byte that means "interrupt") and exclusively.
"""

from __future__ import annotations

import os
import select
import socket
import sys
from typing import Protocol, runtime_checkable
from urllib.parse import urlsplit

from palpate.errors import LinkGone, PortMissing, UsageError
from palpate.link.schemes import address_of, source_of
from palpate.link.serial_port import open_serial

READ_BYTES = 1 << 16
WRITE_TIMEOUT_S = 5.0


@runtime_checkable
class Transport(Protocol):
    """What a client needs of a link.

    `read` returns what has arrived, after `timeout_s` at the latest (then b""); it raises `LinkGone` when the
    other end has vanished.
    """

    name: str

    def read(self, timeout_s: float) -> bytes:
        """What has arrived within `timeout_s`; b"" if nothing has."""

    def write(self, data: bytes) -> None:
        """Send all of `data`."""

    def close(self) -> None:
        """Give the port back."""


class FdTransport:
    """A link on a file descriptor: one `select` and one `os.read` for whatever has come."""

    def __init__(self, name: str, fd: int) -> None:
        self.name = name
        self._fd = fd
        os.set_blocking(fd, False)
        self._closed = False

    def read(self, timeout_s: float) -> bytes:
        """What has arrived within `timeout_s`; b"" if nothing has."""
        if self._closed:
            raise LinkGone(f"{self.name} was closed")
        try:
            ready, _, _ = select.select([self._fd], [], [], timeout_s)
            if not ready:
                return b""
            data = os.read(self._fd, READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return b""
        except (OSError, ValueError) as error:
            raise self._gone() from error
        if not data:
            raise self._gone()
        return data

    def write(self, data: bytes) -> None:
        """Send all of `data`."""
        view = memoryview(data)
        while view:
            try:
                _, ready, _ = select.select([], [self._fd], [], WRITE_TIMEOUT_S)
                if not ready:
                    raise LinkGone(
                        f"{self.name} has not taken a byte for {WRITE_TIMEOUT_S:g} s; reset the probe"
                    )
                view = view[os.write(self._fd, view) :]
            except (BlockingIOError, InterruptedError):
                continue
            except (OSError, ValueError) as error:
                raise self._gone() from error

    def close(self) -> None:
        """Give the port back."""
        if not self._closed:
            self._closed = True
            self._close_port()

    def _close_port(self) -> None:
        os.close(self._fd)

    def _gone(self) -> LinkGone:
        return LinkGone(
            f"{self.name} is gone: the probe was unplugged or its program ended; plug it in again"
        )


class SerialTransport(FdTransport):
    """A serial port or a pseudo-terminal, through pyserial (raw, exclusive)."""

    def __init__(self, port: str, baud: int = 921_600) -> None:
        self._serial = open_serial(port, baud)
        super().__init__(port, self._serial.fileno())

    def _close_port(self) -> None:
        self._serial.close()


class SocketTransport(FdTransport):
    """`socket://HOST:PORT`, as pyserial spells it, but read in blocks and not byte by byte."""

    def __init__(self, url: str, connect_timeout_s: float = 5.0) -> None:
        host, port = _host_port(url)
        try:
            self._socket = socket.create_connection((host, port), timeout=connect_timeout_s)
        except socket.gaierror as error:
            raise PortMissing(url, f"{url}: there is no machine called {host!r}; check the name") from error
        except TimeoutError as error:
            raise PortMissing(url, f"{url} does not answer; check the address and the firewall") from error
        except ConnectionRefusedError as error:
            message = f"nothing listens at {url}; start the probe there, as with `palpate emulate --listen`"
            raise PortMissing(url, message) from error
        except OSError as error:
            raise PortMissing(url, f"{url} cannot be reached: {error.strerror or error}") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        super().__init__(url, self._socket.fileno())

    def _close_port(self) -> None:
        self._socket.close()


class PyserialTransport:
    """Any other port pyserial knows (Windows' COM ports, `rfc2217://`), through its own reads."""

    def __init__(self, port: str, baud: int = 921_600) -> None:
        self.name = port
        self._serial = open_serial(port, baud)

    def read(self, timeout_s: float) -> bytes:
        """What has arrived within `timeout_s`; b"" if nothing has."""
        from serial import SerialException

        try:
            self._serial.timeout = timeout_s
            return bytes(self._serial.read(max(1, self._serial.in_waiting)))
        except (SerialException, OSError, TypeError) as error:
            raise LinkGone(f"{self.name} is gone: the probe was unplugged; plug it in again") from error

    def write(self, data: bytes) -> None:
        """Send all of `data`."""
        from serial import SerialException

        try:
            self._serial.write(data)
        except (SerialException, OSError) as error:
            raise LinkGone(f"{self.name} is gone: the probe was unplugged; plug it in again") from error

    def close(self) -> None:
        """Give the port back."""
        self._serial.close()


def open_transport(port: str, baud: int = 921_600) -> Transport:
    """Open a port by its name: a path, `COM5`, `socket://HOST:PORT`, another pyserial URL, or
    somebody's array (`palpate.link.schemes`).

    Parameters
    ----------
    port : str
        As pyserial takes it. `auto` and serial numbers are `palpate.link.devices.resolve`'s.
    baud : int
        Bits per second of a UART; USB and pseudo-terminals do not care.

    Raises
    ------
    PortMissing, PortBusy, PortForbidden, PortError
        It cannot be opened; the sentence says why and what to do.
    UsageError
        The URL cannot be read.
    """
    if (address := address_of(port)) is not None:
        opened: Transport = source_of(address).open(address)
        return opened
    if port.startswith("socket://"):
        return SocketTransport(port)
    if "://" in port or sys.platform == "win32":
        return PyserialTransport(port, baud)
    return SerialTransport(port, baud)


def _host_port(url: str) -> tuple[str, int]:
    parts = urlsplit(url)
    try:
        if not parts.hostname or parts.port is None:
            raise ValueError
        return parts.hostname, parts.port
    except ValueError:
        raise UsageError(
            f"{url!r} is not an address; write socket://HOST:PORT, as socket://localhost:7624"
        ) from None

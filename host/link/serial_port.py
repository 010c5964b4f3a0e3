"""A serial port opened raw and exclusively, or the sentence that says why it cannot be."""

from __future__ import annotations

import errno
import os

from palpate.errors import PortBusy, PortError, PortForbidden, PortMissing, UsageError
from palpate.link import holders

try:
    import termios

    TERMINAL_ERROR: type[Exception] = termios.error
except ImportError:  # Windows has none
    TERMINAL_ERROR = OSError

MISSING = (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.ENOTDIR, errno.EIO)
"""Codes of a port that is not there, or vanished while it was opened."""


def open_serial(port: str, baud: int):  # type: ignore[no-untyped-def]
    """A pyserial port.

    Raises
    ------
    PortMissing, PortBusy, PortForbidden, PortError
        It cannot be opened; the sentence says why and what to do.
    UsageError
        The name cannot be read.
    """
    import serial

    # Most programs take no lock on a port: who has it open shows only in /proc.
    path = os.path.realpath(port)
    if path.startswith("/dev/") and (pids := holders.open_by(path)) and _is_terminal(path):
        raise _busy(port, holders.program(pids[0]))
    try:
        return serial.serial_for_url(port, baudrate=baud, timeout=0, exclusive=True)
    except ValueError as error:
        raise UsageError(f"{port!r} is not a port: {error}; `palpate devices` lists the ports") from error
    except (serial.SerialException, OSError, TERMINAL_ERROR) as error:
        code = getattr(error, "errno", None) or (error.args[0] if error.args else None)
        if code in MISSING or "FileNotFound" in str(error):
            message = f"there is no port {port}; plug the probe in, and see `palpate devices`"
            raise PortMissing(port, message) from error
        if code in (errno.EAGAIN, errno.EBUSY) or "PermissionError" in str(error):
            raise _busy(port, holders.holder(port)) from error
        if code in (errno.EACCES, errno.EPERM):
            raise _forbidden(port) from error
        if code in (errno.ENOTTY, errno.EINVAL, errno.EISDIR) or "Could not configure port" in str(error):
            raise PortError(
                port, f"{port} is not a serial port; `palpate devices` lists the ports"
            ) from error
        raise PortError(port, f"{port} cannot be opened: {error}") from error


def _is_terminal(path: str) -> bool:
    """False for /dev/null and the like, which many programs hold; True where nobody may look."""
    try:
        fd = os.open(path, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError:
        return True
    try:
        return os.isatty(fd)
    finally:
        os.close(fd)


def _busy(port: str, holder: str | None) -> PortBusy:
    who = holder or "another program"
    return PortBusy(port, f"{port} is busy: {who} holds it; close that program and try again", holder)


def _forbidden(port: str) -> PortForbidden:
    group = holders.owner_group(port)
    if group and group != "root":
        todo = f"join the group {group!r} (sudo usermod -aG {group} $USER) and log in again"
    else:
        todo = "a udev rule must give it to a group of yours; docs/troubleshooting.md has one"
    return PortForbidden(port, f"you may not open {port}; {todo}", group)

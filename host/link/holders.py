"""Who holds a port and who may open it, where the system can tell (Linux: /proc; elsewhere: None)."""

from __future__ import annotations

import os
from pathlib import Path


def lock_holder(path: str) -> int | None:
    """Process id that holds the exclusive lock (flock) on a device, or None.

    Parameters
    ----------
    path : str
        Device path, as /dev/ttyACM0.
    """
    try:
        status = os.stat(path)
        lines = Path("/proc/locks").read_text().splitlines()
    except OSError:
        return None
    wanted = (os.major(status.st_dev), os.minor(status.st_dev), status.st_ino)
    for line in lines:
        # "1: FLOCK  ADVISORY  WRITE 12098 00:1a:3 0 EOF": device numbers in hex, inode in decimal.
        words = line.split()
        if len(words) < 6 or words[1] not in ("FLOCK", "OFDLCK", "POSIX"):
            continue
        major, minor, inode = words[5].split(":")
        if (int(major, 16), int(minor, 16), int(inode)) == wanted and int(words[4]) > 0:
            return int(words[4])
    return None


def open_by(path: str) -> list[int]:
    """Other processes that have a device open, found in /proc/*/fd (root finds all, others their own).

    Whoever holds the other end of a pseudo-terminal is the device itself and does not count.
    """
    try:
        wanted = os.stat(path).st_rdev
    except OSError:
        return []
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        if int(entry.name) == os.getpid():
            continue
        try:
            devices = [fd for fd in (entry / "fd").iterdir() if os.readlink(fd).startswith("/dev/")]
            if (
                wanted
                and any(fd.stat().st_rdev == wanted for fd in devices)
                and not any(_other_end(entry, fd) == path for fd in devices)
            ):
                found.append(int(entry.name))
        except OSError:
            continue  # gone meanwhile, or another user's
    return found


def _other_end(process: Path, fd: Path) -> str:
    """The pseudo-terminal whose controlling end this descriptor is, or ""."""
    if not os.readlink(fd).endswith("ptmx"):
        return ""
    for line in (process / "fdinfo" / fd.name).read_text().splitlines():
        if line.startswith("tty-index:"):
            return f"/dev/pts/{line.split()[1]}"
    return ""


def program(pid: int) -> str:
    """ "name (process 123)", the name as the system knows it."""
    try:
        name = Path(f"/proc/{pid}/comm").read_text().strip()
    except OSError:
        name = "a program"
    return f"{name} (process {pid})"


def holder(path: str) -> str | None:
    """The program that holds a port, or None where the system cannot tell."""
    pid = lock_holder(path)
    if pid is None:
        others = open_by(path)
        pid = others[0] if others else None
    return None if pid is None else program(pid)


def owner_group(path: str) -> str | None:
    """Name of the group that owns a device: the one to join to be allowed to open it."""
    try:
        import grp

        return grp.getgrgid(os.stat(path).st_gid).gr_name
    except (ImportError, OSError, KeyError):
        return None

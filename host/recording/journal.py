"""A file that is whole up to the last commit, whatever happens: kill -9, a full disk, a crash of the program.

Records gather in memory and reach the system with one `write` per commit, so a file cut at any byte ends
in at most one incomplete record, which readers skip. (Against a power cut of the computer the
system is asked every second to write to the disk.)
"""

from __future__ import annotations

import errno
import os
import secrets
import time
from pathlib import Path

from palpate.errors import DiskFull, RecordingError

FSYNC_EVERY_S = 1.0


class JournalFile:
    """The stream that an MCAP writer writes to.

    Parameters
    ----------
    path : Path
        Must not exist unless `overwrite`; appears with its first commit, never empty. Of two that take one
        new name at once the second is told that it is taken.

    Raises
    ------
    RecordingError
        It exists, or cannot be created.
    """

    def __init__(self, path: Path, overwrite: bool = False) -> None:
        if path.exists() and not overwrite:
            raise _taken(path)
        self.path = path
        self._overwrite = overwrite
        self._temporary: Path | None = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
        self._buffer = bytearray()
        self._committed = 0
        self._synced = time.monotonic()
        self._full = False
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._fd = os.open(self._temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise RecordingError(f"{path} cannot be created: {reason}; choose another place") from error

    def write(self, data: bytes) -> int:
        """Add to what the next commit writes (the MCAP writer calls this)."""
        self._buffer += data
        return len(data)

    def tell(self) -> int:
        """Length of the file once committed."""
        return self._committed + len(self._buffer)

    def commit(self) -> None:
        """Give the system everything so far, as whole records.

        Raises
        ------
        DiskFull
            There is no room; the file is cut back to the commit before and stays readable.
        """
        if self._full:
            raise self._disk_full()
        view = memoryview(self._buffer)
        written = 0
        try:
            while written < len(view):
                written += os.write(self._fd, view[written:])
        except OSError as error:
            view.release()
            self._buffer.clear()
            os.ftruncate(self._fd, self._committed)
            if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
                self._full = True
                raise self._disk_full() from error
            reason = (error.strerror or str(error)).lower()
            message = f"{self.path} cannot be written: {reason}; what was written is kept"
            raise RecordingError(message) from error
        view.release()
        self._committed += written
        self._buffer.clear()
        if self._temporary is not None:
            self._publish(self._temporary)
            self._temporary = None
        now = time.monotonic()
        if now - self._synced > FSYNC_EVERY_S:
            self._synced = now
            _start_writing_out(self._fd)

    def in_place(self) -> bool:
        """Whether what stands at `path` is this file, and not one that took its place since."""
        try:
            return self._fd >= 0 and os.path.samestat(os.fstat(self._fd), self.path.stat())
        except OSError:
            return False

    def _publish(self, temporary: Path) -> None:
        """Give the file its name; a file that took the name since is left alone."""
        if self._overwrite:
            os.replace(temporary, self.path)
            return
        try:
            try:
                os.link(temporary, self.path)
            except FileExistsError:
                raise
            except OSError:  # a file system without hard links: hold the name first
                os.close(os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644))
                os.replace(temporary, self.path)
        except FileExistsError:
            raise _taken(self.path) from None
        temporary.unlink(missing_ok=True)

    def drop(self) -> None:
        """Forget what was not committed."""
        self._buffer.clear()

    def close(self) -> None:
        """Close the file; uncommitted records are dropped."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
            if self._temporary is not None:
                self._temporary.unlink(missing_ok=True)

    def _disk_full(self) -> DiskFull:
        return DiskFull(
            f"the disk is full: {self.path} ends with its last complete frame "
            f"({self._committed / 1e6:.1f} MB); "
            "make room and start a new recording"
        )


def _taken(path: Path) -> RecordingError:
    return RecordingError(f"{path} exists already; choose another name or give --overwrite")


def _start_writing_out(fd: int) -> None:
    """Have the system write to the disk; on Linux without waiting for it, so that no frame is late."""
    if hasattr(os, "posix_fadvise"):
        os.posix_fadvise(fd, 0, 0, os.POSIX_FADV_DONTNEED)  # begins write-back of dirty pages, does not block
    else:
        os.fsync(fd)

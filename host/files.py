"""Files that we write: whole or not at all, and a sentence where that fails."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import stat
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, TypeVar

from palpate.errors import DiskFull, NoSuchFile, PalpateError, UnknownFormat, UsageError

T = TypeVar("T")


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its place when the block ends well; its directory is made.

    Raises
    ------
    DiskFull, PalpateError
        The file cannot be written; what stood at `path` is untouched.
    """
    _refuse_device(path)
    # The suffix stays last: libraries choose the format by it.
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        _sync(temporary)
        os.replace(temporary, path)
        _sync(path.parent)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextmanager
def writing_alone(path: Path) -> Iterator[None]:
    """Wait until no other process of ours is within this block for `path`; a killed one holds nothing up.

    Raises
    ------
    DiskFull, PalpateError
        Nothing can be written beside it.
    """
    beside = path.with_name(f".{path.name}.lock")
    while True:
        try:
            held = open(beside, "a+b")  # noqa: SIM115 (held through the block)
            lock_file(held, wait=True)
            if _is(held, beside):  # not one that its owner has just removed
                break
        except OSError as error:
            raise cannot_write(path, error) from error
        held.close()
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # Windows removes nothing that is open
            beside.unlink()
        held.close()


def _is(held: IO[bytes], path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(held.fileno()), path.stat())
    except FileNotFoundError:
        return False


def lock_file(file: IO[bytes], wait: bool) -> None:
    """Lock a file until it is closed or its process ends; OSError where another has it and we do not wait."""
    try:
        import fcntl
    except ImportError:  # Windows has another
        with contextlib.suppress(ImportError):
            import msvcrt

            msvcrt.locking(file.fileno(), msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        fcntl.flock(file, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)


def json_text(value: Any, indent: str = "") -> str:
    """JSON to be kept and compared: keys sorted, and a row of a table on one line.

    Raises
    ------
    ValueError, TypeError
        There is a number that is not finite, or what JSON has no word for.
    """
    deeper = indent + " "
    if isinstance(value, dict) and value:
        parts = [f"{json.dumps(str(key))}: {json_text(value[key], deeper)}" for key in sorted(value)]
        ends = "{}"
    elif isinstance(value, (list, tuple)) and any(isinstance(one, (dict, list, tuple)) for one in value):
        parts = [json_text(one, deeper) for one in value]
        ends = "[]"
    else:
        return json.dumps(value, allow_nan=False)
    return f"{ends[0]}\n{deeper}" + f",\n{deeper}".join(parts) + f"\n{indent}{ends[1]}"


def check_writable(path: Path) -> None:
    """Raise what `whole_file` would, before the work that a file is for; nothing is left behind."""
    _refuse_device(path)
    probe = path.with_name(f".{path.stem}.{os.getpid()}.try")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise cannot_write(path, error) from error


def _refuse_device(path: Path) -> None:
    if path.exists() and not path.is_file():  # what is put in its place would replace /dev/full itself
        raise PalpateError(f"{path} cannot be written: it is a device or a directory; name a file")


def _sync(path: Path) -> None:
    """Return once a file's content, or a directory's names, are on disk."""
    if os.name == "nt" and path.is_dir():
        return
    handle = os.open(path, os.O_RDONLY if os.name != "nt" else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def cannot_write(path: Path, error: OSError) -> PalpateError:
    """The sentence for a file that could not be written."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return DiskFull(f"the disk is full: {path} was not written; make room and try again")
    return PalpateError(f"{path} cannot be written: {(error.strerror or str(error)).lower()}")


def check_readable(path: Path, most: int) -> None:
    """Before a library reads a file to its end: `UsageError` for a device, a pipe, a name that no file can
    have, and for more than `most` bytes; OSError as `stat` raises it."""
    try:
        about = path.stat()
    except ValueError:
        raise UsageError(f"{str(path)!r} is no file's name") from None
    if not (stat.S_ISREG(about.st_mode) or stat.S_ISDIR(about.st_mode)):
        raise UsageError(f"{path} is a device or a pipe; name a file")
    if about.st_size > most:
        raise UsageError(f"{path} has {about.st_size / 1e6:.0f} MB; {most / 1e6:.0f} are read at most")


def read_limited(path: Path, most: int) -> bytes:
    """The bytes of a file; `UsageError` where there are more than `most`, and OSError as `open` raises it."""
    with path.open("rb") as stream:
        data = stream.read(most + 1)
    if len(data) > most:
        raise UsageError(f"{path} is larger than {most / 1e6:.3g} MB, too large to be what it should be")
    return data


def read_whole(path: Path, what: str, most: int = 1 << 20) -> bytes:
    """The bytes of a file that a user named; `what` is the word for it in errors, `most` its largest size."""
    try:
        return read_limited(path, most)
    except FileNotFoundError:
        raise NoSuchFile(f"there is no {what} {path}; check the name") from None
    except OSError as error:
        raise NoSuchFile(f"the {what} {path} cannot be read: {(error.strerror or '').lower()}") from None


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """The tables of a TOML file that a user named; `what` is the word for it in errors."""
    try:
        return tomllib.loads(read_whole(path, what).decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise UsageError(f"{path} is not TOML: {error}") from None


def by_suffix(path: Path, writers: dict[str, Callable[..., T]]) -> Callable[..., T]:
    """The writer for a file's suffix; `UnknownFormat` names those there are."""
    if path.suffix.lower() not in writers:
        known = ", ".join(writers)
        raise UnknownFormat(f"{path}: a file ending in {path.suffix or 'nothing'!r} is unknown; use {known}")
    return writers[path.suffix.lower()]

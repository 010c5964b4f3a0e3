"""The file system in the Pico's flash: littlefs blocks made from files, and files read from blocks."""

from __future__ import annotations

from collections.abc import Mapping

from littlefs import LittleFS, LittleFSError, UserContext

from palpate.errors import PalpateError

START = 0xA0000  # where MicroPython's own port begins its file system on a Pico
BLOCK = 4096
BLOCKS = 352
BYTES = BLOCK * BLOCKS
_DISK = 0x00020000  # littlefs 2.0, which every MicroPython reads; it makes a 2.1 of it when it first writes
SECTOR_ERASE, BLOCK_ERASE, PAGE_PROGRAM = 0x20, 0xD8, 0x02
CHANGES = (SECTOR_ERASE, BLOCK_ERASE, PAGE_PROGRAM)


def _system(context: UserContext, disk_version: int = 0) -> LittleFS:
    return LittleFS(
        context=context,
        block_size=BLOCK,
        block_count=BLOCKS,
        mount=False,  # it would format what it cannot mount
        read_size=32,
        prog_size=32,
        disk_version=disk_version,
    )


def image(files: Mapping[str, bytes]) -> bytes:
    """The blocks of a file system that holds these files; directories are made."""
    context = UserContext(BYTES)
    system = _system(context, disk_version=_DISK)
    system.format()
    system.mount()
    for name, data in files.items():
        folder = name.rpartition("/")[0]
        if folder:
            system.makedirs(folder, exist_ok=True)
        with system.open(name, "wb") as file:
            file.write(data)
    return bytes(context.buffer)


def read(blocks: bytes, device: UserContext | None = None) -> dict[str, bytes]:
    """All files of a file system, made here or written to by MicroPython. Raises PalpateError.

    device: what littlefs reads the blocks from; None: from memory
    """
    if device is None:
        device = UserContext(BYTES)
        device.buffer = bytearray(blocks)
    system = _system(device)
    try:
        system.mount()
    except LittleFSError as error:
        raise PalpateError(f"the flash chip's file system cannot be read ({error})") from error
    found = {}
    for folder, _, names in system.walk("/"):
        for name in names:
            path = f"{folder.rstrip('/')}/{name}"
            with system.open(path, "rb") as file:
                found[path.lstrip("/")] = file.read()
    return found

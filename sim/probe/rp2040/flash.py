"""The file system in the Pico's flash: littlefs blocks made from files, and files read from blocks."""

from __future__ import annotations

from collections.abc import Mapping

from littlefs import LittleFS, UserContext

START = 0xA0000  # where MicroPython's own port begins its file system on a Pico
BLOCK = 4096
BLOCKS = 352
BYTES = BLOCK * BLOCKS
_DISK = 0x00020000  # littlefs 2.0
SECTOR_ERASE, BLOCK_ERASE, PAGE_PROGRAM = 0x20, 0xD8, 0x02
CHANGES = (SECTOR_ERASE, BLOCK_ERASE, PAGE_PROGRAM)


def _mounted(blocks: bytes | None) -> LittleFS:
    context = UserContext(BYTES)
    if blocks is not None:
        context.buffer = bytearray(blocks)
    return LittleFS(
        context=context,
        block_size=BLOCK,
        block_count=BLOCKS,
        disk_version=_DISK,
        mount=True,
        read_size=32,
        prog_size=32,
    )


def image(files: Mapping[str, bytes]) -> bytes:
    """The blocks of a file system that holds these files; directories are made."""
    system = _mounted(None)
    for name, data in files.items():
        folder = name.rpartition("/")[0]
        if folder:
            system.makedirs(folder, exist_ok=True)
        with system.open(name, "wb") as file:
            file.write(data)
    return bytes(system.context.buffer)


def read(blocks: bytes) -> dict[str, bytes]:
    """All files of a file system."""
    system = _mounted(blocks)
    found = {}
    for folder, _, names in system.walk("/"):
        for name in names:
            path = f"{folder.rstrip('/')}/{name}"
            with system.open(path, "rb") as file:
                found[path.lstrip("/")] = file.read()
    return found

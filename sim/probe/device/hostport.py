"""The hardware of the emulated probe for CPython; ../wasm/device.mjs is the same for MicroPython.

Link: file descriptors 0 (from the host) and 1 (to the host), both non-blocking. Orders of the emulator
(sim/probe/emulated.py): on the one that the configuration names, a line each; its end means that the
emulator is gone. Into a pipe that it names goes a byte when the firmware first listens.
"""

import json
import os
import select
import signal
import struct
import sys
import time
from pathlib import Path
from typing import Any

_LINK_IN, _LINK_OUT = 0, 1
_MASK = (1 << 30) - 1
_config: dict[str, Any] = {}
_source = b""
_cursor = 0
_current = 0
_order_text = ""
_power_left = float("inf")


def configure(path: str) -> None:
    """Read the configuration that the emulator has written."""
    global _power_left
    _config.update(json.loads(Path(path).read_text()))
    if _config.get("power_bytes") is not None:
        _power_left = _config["power_bytes"]
    if _config.get("source"):
        _load(_config["source"])


def _load(path: str) -> None:
    global _source, _cursor
    _source = Path(path).read_bytes()
    _cursor = 0


def _take(fd: int, n: int) -> bytes:
    """What is there to read, or b"" where nothing is yet.

    Ends the process where nothing will come any more.
    """
    try:
        data = os.read(fd, n)
    except BlockingIOError:
        return b""
    except OSError:  # a pseudo-terminal that nobody holds open
        return b""
    if not data:
        sys.exit(0)
    return data


def _apply_orders() -> None:
    global _order_text, _power_left
    _order_text += _take(_config["orders"], 4096).decode()
    while "\n" in _order_text:
        line, _order_text = _order_text.split("\n", 1)
        order, _, rest = line.partition(" ")
        if order == "source":
            _load(rest)
        elif order == "power":
            _power_left = int(rest)


def _say_that_it_listens() -> None:
    if (fd := _config.pop("listens", None)) is not None:
        os.write(fd, b"!")
        os.close(fd)


def read(buffer: bytearray, n: int) -> int:
    _say_that_it_listens()
    data = _take(_LINK_IN, n)
    buffer[: len(data)] = data
    return len(data)


def write(buffer: bytearray, start: int, stop: int) -> int:
    try:
        return os.write(_LINK_OUT, memoryview(buffer)[start:stop])
    except OSError:  # full, or nobody at the other end
        return 0


def ticks_us() -> int:
    return time.monotonic_ns() // 1000 & _MASK


def idle(us: int) -> None:
    orders = _config["orders"]
    ready, _, _ = select.select([_LINK_IN, orders], [], [], max(us, 0) / 1e6)
    if orders in ready:
        _apply_orders()


def begin() -> None:
    global _cursor
    if select.select([_config["orders"]], [], [], 0)[0]:
        _apply_orders()
    _cursor = 0


def end() -> None:
    pass


def position_um() -> int:
    global _current
    _current = _cursor
    return struct.unpack_from("<i", _source, _current)[0]


def displacement_um() -> int:
    return struct.unpack_from("<i", _source, _current + 4)[0]


def scan(counts: memoryview) -> None:
    global _cursor
    counts[:] = _source[_current + 8 : _current + _config["record"]]
    _cursor += _config["record"]
    if _cursor >= len(_source):
        _cursor = 0 if _config["repeat"] else len(_source) - _config["record"]


def serial_byte(i: int) -> int:
    return _config["serial"][i]


def boots() -> int:
    return _config["boots"]


def key_byte(i: int) -> int:
    key = _config["public_key"]
    return key[i] if key and i < len(key) else -1


def _where(name: str) -> Path:
    return Path(_config["store"]) / name


def store_size(name: str) -> int:
    try:
        return _where(name).stat().st_size
    except OSError:
        return -1


def store_read(name: str, offset: int, buffer: bytearray, n: int) -> int:
    try:
        with _where(name).open("rb") as file:
            file.seek(offset)
            return file.readinto(memoryview(buffer)[:n])
    except OSError:
        return 0


def store_write(name: str, offset: int, data: bytes, n: int) -> int:
    global _power_left
    _apply_orders()  # a cut that was ordered before this write must find it
    whole = int(min(n, _power_left))
    try:
        fd = os.open(_where(name), os.O_RDWR | os.O_CREAT, 0o644)
        try:
            os.pwrite(fd, memoryview(data)[:whole], offset)
        finally:
            os.close(fd)
    except OSError:
        return int(_config["store_error"])
    _power_left -= n
    if _power_left <= 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return 0


def store_sync() -> int:
    return 0


def store_remove(name: str) -> int:
    _where(name).unlink(missing_ok=True)
    return 0

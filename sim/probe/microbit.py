"""Debian's MicroPython 1.9.2 for the BBC micro:bit (Cortex-M0, 16 KB of RAM) in QEMU.

Lines go to its raw REPL, memory is reached through the debug port. Each step waits for its answer, so nothing
depends on how busy this machine is. palpate.sim.probe.on_microbit puts the firmware's functions there.
"""

import contextlib
import functools
import re
import shutil
import socket
import subprocess
import time
from pathlib import Path

from palpate.sim.probe.debug_port import DebugPort
from palpate.sim.probe.node import RuntimeMissing
from palpate.sim.probe.scripts import ScriptFailed

IMAGE = Path("/usr/share/firmware-microbit-micropython/firmware.hex")
QEMU = "qemu-system-arm"
PATIENCE_S = 240.0  # for one answer, however busy this machine
RING = 60  # bytes: what the receive ring holds for certain
# When its heap is tidied in the middle of a line, this version at times believes that there is none left.
# Nothing of the line was run then, and the same line goes through the next time.
_NOT_PARSED = b'File "<stdin>", line 1\r\nMemoryError: parser could not'
_PARSES = 3
_PROMPT = b"raw REPL; CTRL-B to exit\r\n>"
_HEX_LINE = re.compile(r":(..)(....)(..)(.*)..")


def check_microbit() -> None:
    """Raises RuntimeMissing if QEMU or the firmware is not installed."""
    if shutil.which(QEMU) is None:
        raise RuntimeMissing(
            "QEMU is not installed; run `make setup` or: sudo apt-get install qemu-system-arm"
        )
    if not IMAGE.exists():
        raise RuntimeMissing(
            "the micro:bit's firmware is not installed; run: "
            "sudo apt-get install firmware-microbit-micropython"
        )


@functools.cache
def known_names() -> tuple[str, ...]:
    """Names that the interpreter has in flash (a byte of hash, one of length, text, 0): they cost no RAM."""
    flash, base = bytearray(0x40000), 0
    for line in IMAGE.read_text().splitlines():
        match = _HEX_LINE.match(line)
        if match is None:
            continue
        address, kind, data = int(match[2], 16), int(match[3]), bytes.fromhex(match[4])
        if kind == 4:
            base = int.from_bytes(data, "big") << 16
        elif kind == 0 and base + address < len(flash):
            flash[base + address : base + address + len(data)] = data
    found = []
    for name in re.finditer(rb"(?s)(?=(.)(.)([A-Za-z_]\w*)\0)", bytes(flash)):
        text = name[3]
        number = 5381
        for byte in text:
            number = number * 33 ^ byte
        if name[2][0] == len(text) and name[1][0] == (number & 255 or 1):
            found.append(text.decode())
    return tuple(sorted(dict.fromkeys(found), key=len))


class MicroBit:
    """A running micro:bit; use it as a context manager.

    Raises RuntimeMissing where QEMU or the firmware is missing, TimeoutError where it does not answer.
    """

    def __init__(self) -> None:
        check_microbit()
        with (
            socket.create_server(("127.0.0.1", 0)) as serial,
            socket.create_server(("127.0.0.1", 0)) as debug,
        ):
            ports = [listener.getsockname()[1] for listener in (serial, debug)]
            command = [QEMU, "-M", "microbit", "-nographic", "-monitor", "none"]
            command += ["-serial", f"tcp:127.0.0.1:{ports[0]},nodelay=on"]
            command += ["-chardev", f"socket,id=debug,host=127.0.0.1,port={ports[1]},nodelay=on"]
            command += ["-gdb", "chardev:debug"]
            command += ["-device", f"loader,file={IMAGE}"]
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            try:
                for listener in (serial, debug):
                    listener.settimeout(PATIENCE_S)
                self._socket = serial.accept()[0]
                connection = debug.accept()[0]
                connection.settimeout(PATIENCE_S)
                self.port = DebugPort(connection)
                self.port.go()
                self._until(b">>> ")
                self._socket.sendall(b"\x01")
                self._until(_PROMPT)
                self.port.stop()
            except BaseException:
                self._process.kill()
                self._process.wait(10)
                raise

    def __enter__(self) -> "MicroBit":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Switch it off."""
        with contextlib.suppress(OSError):
            self.port.close()
            self._socket.close()
        self._process.kill()
        self._process.wait(10)

    def _until(self, token: bytes) -> bytes:
        """What it says, up to and with `token`."""
        said = bytearray()
        end = time.monotonic() + PATIENCE_S
        while not said.endswith(token):
            self._socket.settimeout(max(end - time.monotonic(), 0.001))
            try:
                piece = self._socket.recv(1)
            except TimeoutError:
                raise TimeoutError(f"the micro:bit does not answer; it said {bytes(said[-300:])!r}") from None
            if not piece:
                raise ConnectionError("the micro:bit has stopped")
            said += piece
        return bytes(said)

    def run(self, line: str) -> str:
        """Run a line (or short lines) and return what it printed; it is stopped before and after.

        Raises ScriptFailed with the micro:bit's own words.
        """
        data = line.encode()
        assert len(data) < RING, line  # it must not lose any of it
        for _ in range(_PARSES):
            self.port.go()
            self._socket.sendall(data + b"\x04")
            self._until(b"OK")
            out = self._until(b"\x04")[:-1]
            error = self._until(b"\x04>")[:-2]
            self.port.stop()
            if _NOT_PARSED not in error:
                break
        if error:
            raise ScriptFailed(error.decode(errors="replace").strip())
        return out.decode().replace("\r\n", "\n")

    def free_bytes(self) -> int:
        """What is left of the heap."""
        return int(self.run("gc.collect()\nprint(gc.mem_free())"))

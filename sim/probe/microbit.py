"""Debian's MicroPython 1.9.2 for the BBC micro:bit (Cortex-M0, 16 KB of RAM) in QEMU: scripts over its
raw REPL.

Two thirds of a module is more than its compiler can hold at once, so functions go there one by one
(sim.probe.flat).
"""

import contextlib
import shutil
import socket
import struct
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

from sim.probe.flat import Flattener
from sim.probe.node import RuntimeMissing
from sim.probe.scripts import ScriptFailed

IMAGE = Path("/usr/share/firmware-microbit-micropython/firmware.hex")
QEMU = "qemu-system-arm"
_RING = 60  # bytes: what the receive ring holds for certain; what is longer goes in several lines
_LINE = 52
_PROMPT = b"raw REPL; CTRL-B to exit\r\n>"


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


class MicroBit:
    """A running micro:bit; use it as a context manager.

    Raises RuntimeMissing where QEMU or the firmware is missing, TimeoutError where it does not answer.
    """

    def __init__(self) -> None:
        check_microbit()
        self._arrays: dict[str, tuple[str, int]] = {}
        listener = socket.create_server(("127.0.0.1", 0))
        port = listener.getsockname()[1]
        command = [QEMU, "-M", "microbit", "-nographic", "-monitor", "none"]
        command += ["-serial", f"tcp:127.0.0.1:{port},nodelay=on", "-device", f"loader,file={IMAGE}"]
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            listener.settimeout(20)
            self._socket, _ = listener.accept()
            self._until(b">>> ", 20)
            self._interrupt()
        except BaseException:
            self._process.kill()
            self._process.wait(10)
            raise
        finally:
            listener.close()

    def __enter__(self) -> "MicroBit":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Switch it off."""
        with contextlib.suppress(OSError):
            self._socket.close()
        self._process.kill()
        self._process.wait(10)

    def _until(self, token: bytes, timeout_s: float) -> bytes:
        """What it says, up to and with `token`."""
        said = bytearray()
        end = time.monotonic() + timeout_s
        while not said.endswith(token):
            self._socket.settimeout(max(end - time.monotonic(), 0.001))
            try:
                piece = self._socket.recv(1)
            except TimeoutError:
                raise TimeoutError(f"the micro:bit does not answer; it said {bytes(said[-300:])!r}") from None
            if not piece:
                raise TimeoutError("the micro:bit has stopped")
            said += piece
        return bytes(said)

    def _interrupt(self) -> None:
        self._socket.sendall(b"\r\x03\x03")
        time.sleep(0.05)
        self._socket.sendall(b"\x01")
        self._until(_PROMPT, 10)

    def _exec(self, line: str, timeout_s: float) -> str:
        """Run one short line. It is shorter than the receive ring, so that none of it can be lost."""
        data = line.encode()
        assert len(data) < _RING
        self._socket.sendall(data + b"\x04")
        self._until(b"OK", timeout_s)
        out = self._until(b"\x04", timeout_s)[:-1]
        err = self._until(b"\x04>", timeout_s)[:-2]
        if err:
            raise ScriptFailed(err.decode(errors="replace").strip())
        return out.decode().replace("\r\n", "\n")

    def run(self, script: str, timeout_s: float = 60) -> str:
        """Run a script and return what it printed. Raises ScriptFailed with the micro:bit's own words."""
        if len(script.encode()) < _RING:
            return self._exec(script, timeout_s)
        self._exec("S=''", timeout_s)
        at = 0
        while at < len(script):
            n = _LINE
            while len(repr(script[at : at + n])) + 4 >= _RING:
                n -= 1
            self._exec("S+=" + repr(script[at : at + n]), timeout_s)
            at += n
        try:
            return self._exec("exec(S)", timeout_s)
        finally:
            self._exec("S=''", timeout_s)

    def write(self, name: str, data: bytes) -> None:
        """Write a file and read it back."""
        self.run(f"f=open({name!r},'wb')")
        at = 0
        while at < len(data):
            n = 44
            while len(repr(data[at : at + n])) + 9 >= _RING:
                n -= 1
            self.run(f"f.write({data[at : at + n]!r})")
            at += n
        self.run("f.close()")
        said = self.run(
            f"f=open({name!r},'rb')\nn=0\ns=0\nwhile True:\n b=f.read(64)\n if not b:break\n n+=len(b)\n"
            " for x in b:s=(s*31+x)%65521\nprint(n,s)\nf.close()"
        )
        expected = 0
        for byte in data:
            expected = (expected * 31 + byte) % 65521
        if said.split() != [str(len(data)), str(expected)]:
            raise ScriptFailed(f"the micro:bit did not store {name}: {said!r}")

    def load(self, flat: Flattener) -> None:
        """Define the functions and tables that `flat` has collected, as attributes of the module `g`.

        Each is compiled from a file of its own, the longest first: the compiler needs the most memory for it.
        """
        self.write("g.py", b"")
        self.run("import g,gc\nfrom array import array")
        for short, text in sorted(flat.pieces.items(), key=lambda item: -len(item[1])):
            self.write(f"{short}.py", f"import g\n{text}\n".encode())
            self.run("gc.collect()")
            self.run(f"import {short}")
            self.run(f"g.{short}={short}.{short}")
            self.run(f"del {short}\nimport os\nos.remove('{short}.py')")
        for short, numbers in flat.tables.items():
            self.put(f"g.{short}", numbers)

    def put(self, name: str, numbers: Sequence[int], typecode: str = "") -> None:
        """Give a name to an array of numbers (typecode of the array module), or to a tuple of them."""
        if typecode:
            size = struct.calcsize(typecode) * len(numbers)
            if self._arrays.get(name) == (typecode, size):
                self._exec(f"T={name}", 60)
            else:
                self._exec(f"{name}=0", 60)
                self._exec("gc.collect()", 60)
                self._exec(f"T=array({typecode!r},bytes({size}))", 60)
                self._exec(f"{name}=T", 60)
                self._exec("gc.collect()", 60)
            self._arrays[name] = (typecode, size)
            self._exec("k=0", 60)
            pattern = "for v in({},):T[k]=v;k+=1"
        else:
            self._exec("T=[]", 60)
            pattern = "T+=[{}]"
        line = ""
        for number in numbers:
            if line and len(pattern) + len(line) + len(str(number)) > _LINE:
                self._exec(pattern.format(line[:-1]), 60)
                line = ""
            line += f"{number},"
        if line:
            self._exec(pattern.format(line[:-1]), 60)
        if not typecode:
            self._exec(f"{name}=tuple(T)", 60)
        self._exec("T=0\ngc.collect()", 60)

    def free_bytes(self) -> int:
        """What is left of the heap."""
        return int(self.run("import gc\ngc.collect()\nprint(gc.mem_free())"))

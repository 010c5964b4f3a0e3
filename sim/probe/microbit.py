"""Debian's MicroPython 1.9.2 for the BBC micro:bit (Cortex-M0, 16 KB of RAM) in QEMU: scripts over its
raw REPL.

Two thirds of a module is more than its compiler can hold at once, so functions go there one by one
(sim.probe.flat).
"""

import contextlib
import shutil
import socket
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from sim.probe.flat import Flattener
from sim.probe.node import RuntimeMissing
from sim.probe.scripts import ScriptFailed

IMAGE = Path("/usr/share/firmware-microbit-micropython/firmware.hex")
QEMU = "qemu-system-arm"
_RING = 60  # bytes: what the receive ring holds for certain; what is longer goes in several lines
_LINE = 52
_NUMBERS = 5  # sent in one line
_GROUP = 900  # characters that its compiler takes at once when the heap is half full
# Numbers come as eight hexadecimal digits each, 2**31 added: one string is the least to parse.
_HELPERS = """def p(s):
 global k
 for i in range(0,len(s),8):
  T[k]=(int(s[i:i+4],16)-32768)*65536+int(s[i+4:i+8],16)
  k+=1
def h(a):
 s=0
 for x in a:s=(s*31+(x&0xFFFFFF)+(x>>24))%65521
 return s
"""
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

    def load(self, flat: Flattener, arrays: Mapping[str, tuple[str, int]], long: int = 700) -> None:
        """Define the functions and tables that `flat` has collected, as attributes of the module `g`.

        Functions of `long` characters and more first, for their compilation needs most of the heap; then room
        for `arrays` (name -> typecode, length), before the heap is in pieces; then the rest.
        """
        self.write("g.py", b"")
        self.run("import g,gc,os\nfrom array import array")
        pieces = sorted(flat.pieces.items(), key=lambda item: -len(item[1]))
        room_made = False
        while pieces:
            if not room_made and len(pieces[0][1]) < long:
                self.make_room(arrays)
                room_made = True
            # a module stays loaded for ever, so short functions share one
            group = [pieces.pop(0)]
            while pieces and sum(len(text) for _, text in group) + len(pieces[-1][1]) < _GROUP:
                group.append(pieces.pop())
            name = group[0][0]
            text = "import g\n" + "".join(
                f"{text}\ng.{short}={short}\ndel {short}\n" for short, text in group
            )
            self.write(f"{name}.py", text.encode())
            self.run("gc.collect()")
            self.run(f"import {name}")
            self.run(f"del {name}\nos.remove('{name}.py')")
            self.run("gc.collect()")
        self.run(_HELPERS)
        if not room_made:
            self.make_room(arrays)
        for short, numbers in flat.tables.items():
            self.run(f"T=[0]*{len(numbers)}")
            self._fill(numbers)
            self.run(f"g.{short}=tuple(T)\nT=0\ngc.collect()")

    def make_room(self, arrays: Mapping[str, tuple[str, int]]) -> None:
        """Make arrays: name -> typecode, length."""
        for name, (typecode, length) in sorted(arrays.items(), key=lambda item: -item[1][1]):
            self.run("gc.collect()")
            self.run(f"{name}=array({typecode!r},range({length}))")  # of known length: nothing is copied

    def _fill(self, numbers: Sequence[int]) -> None:
        self.run("k=0")
        for at in range(0, len(numbers), _NUMBERS):
            digits = "".join(f"{number + (1 << 31):08x}" for number in numbers[at : at + _NUMBERS])
            self.run(f"p('{digits}')")

    def put(self, name: str, numbers: Sequence[int]) -> None:
        """Fill one of the arrays that `load` made room for."""
        self.run(f"T={name}")
        self._fill(numbers)

    def check_sum(self, name: str) -> int:
        """Of an array; tests compute the same."""
        return int(self.run(f"print(h({name}))"))

    def free_bytes(self) -> int:
        """What is left of the heap."""
        return int(self.run("import gc\ngc.collect()\nprint(gc.mem_free())"))

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
from dataclasses import dataclass
from pathlib import Path

from sim.probe.flat import Flattener
from sim.probe.node import RuntimeMissing
from sim.probe.scripts import ScriptFailed

IMAGE = Path("/usr/share/firmware-microbit-micropython/firmware.hex")
QEMU = "qemu-system-arm"
_RING = 60  # bytes: what the receive ring holds for certain; what is longer goes in several lines
_LINE = 52
_DIGITS = 48  # sent in one line
# Numbers come as W hexadecimal digits each, counted from B: one string is the least to parse.
_HELPERS = """def p(k,s):
 for i in range(0,len(s),W):
  T[k]=int(s[i:i+W],16)+B
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


@dataclass(frozen=True)
class Way:
    """In which order code and data fill the heap, which nothing tidies up.

    long: functions of so many characters and more come before the arrays; group: characters that are compiled
    at once; below: bytes held free below until all is there, or, `early`, until all of the code is.
    """

    long: int = 700
    group: int = 900
    below: int = 0
    early: bool = False


WAYS = (
    Way(),
    Way(300, 450, 700),
    Way(700, 900, 1000),
    Way(9999, 900, 1000),
    Way(300, 900),
    Way(9999, 500),
    Way(0, 600, 2000, True),
    Way(0, 600, 1000, True),
    Way(0, 500),
    Way(0, 700, 600, True),
    Way(250, 1100),
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

    def load(self, flat: Flattener, arrays: Mapping[str, tuple[str, int]], way: Way = WAYS[0]) -> None:
        """Define the functions and tables that `flat` has collected, as attributes of the module `g`.

        The longest first, for their compilation needs most of the heap; see Way for the rest. `arrays`: name
        -> typecode, length. Raises ScriptFailed where they do not fit in this way.
        """
        self.write("g.py", b"")
        self.run("import g,gc,os\nfrom array import array")
        self.run("gc.collect()")
        self.run(f"P=bytearray({way.below})")
        pieces = sorted(flat.pieces.items(), key=lambda item: -len(item[1]))
        room_made = False
        while pieces:
            if not room_made and len(pieces[0][1]) < way.long:
                self.make_room(arrays)
                room_made = True
            # a module stays loaded for ever, so short functions share one
            group = [pieces.pop(0)]
            while pieces and sum(len(text) for _, text in group) + len(pieces[-1][1]) < way.group:
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
        if way.early:
            self.run("P=0\ngc.collect()")
        if not room_made:
            self.make_room(arrays)
        self.run(_HELPERS)
        for short, numbers in flat.tables.items():
            self.run(f"T=[0]*{len(numbers)}")
            self._fill(numbers, None)
            self.run(f"g.{short}=tuple(T)\nT=0\ngc.collect()")
        self.run("P=0\ngc.collect()")

    def make_room(self, arrays: Mapping[str, tuple[str, int]]) -> None:
        """Make arrays: name -> typecode, length."""
        for name, (typecode, length) in sorted(arrays.items(), key=lambda item: -item[1][1]):
            self.run("gc.collect()")
            self.run(f"{name}=array({typecode!r},range({length}))")  # of known length: nothing is copied

    def _fill(self, numbers: Sequence[int], known: Sequence[int] | None) -> None:
        least = min(numbers)
        # a string of ten characters or fewer would stay in its table of names for ever
        width = max(1, -(-(max(numbers) - least).bit_length() // 4), -(-11 // len(numbers)))
        self.run(f"W={width};B={least}")
        most = _DIGITS // width
        at = 0
        while at < len(numbers):
            if known is not None and known[at] == numbers[at]:
                at += 1
                continue
            first = max(0, min(at, len(numbers) - most))
            digits = "".join(f"{number - least:0{width}x}" for number in numbers[first : first + most])
            self.run(f"p({first},'{digits}')")
            at = first + most

    def put(self, name: str, numbers: Sequence[int], known: Sequence[int] | None = None) -> None:
        """Fill one of the arrays that `load` made room for; `known`: what it holds already."""
        self.run(f"T={name}")
        self._fill(numbers, known)

    def check_sum(self, name: str) -> int:
        """Of an array; tests compute the same."""
        return int(self.run(f"print(h({name}))"))

    def free_bytes(self) -> int:
        """What is left of the heap."""
        return int(self.run("import gc\ngc.collect()\nprint(gc.mem_free())"))

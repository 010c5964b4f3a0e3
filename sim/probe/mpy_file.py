"""What is in a .mpy file: MicroPython's compiled modules, version 6, with machine code in them.

The format, from the loader's side (a "uint" comes in groups of seven bits, the most significant first; all
but its last byte have bit 7 set):

    "M", 6, architecture << 2 | sub-version, bits of a small integer
    uint how many names, uint how many constants
    a name:      uint length << 1, its bytes and a zero; or uint number << 1 | 1, one of the interpreter's own
    a constant:  its type; None, False, True, ... and the table of helpers are only that, the others go on
                 with uint length and so many bytes (strings one more, a zero)
    the module's code, and in it that of each of its functions:
                 uint length << 3 | has children << 2 | kind, then so many bytes
                 viper: uint flags
                 has children: uint how many, then they

A viper function is machine code from its first byte on. It is called as C would call
`f(self, n_args, n_kw, args)` and finds through `self` the constants, through these the helpers.
"""

from dataclasses import dataclass, field
from pathlib import Path

ARCHITECTURES = {"armv6m": 4, "armv7m": 5, "armv7emsp": 7}
BYTECODE, NATIVE, VIPER = 0, 1, 2
HELPERS = 0  # the type of the constant that stands for the interpreter's table of helpers
_EMPTY = range(5)  # that, None, False, True, ...
_STRINGS = (5, 6)
_MAKE_FUNCTION = 0x32
_STORE_NAME = 0x16
_FLAGS_OF_DATA = 0x70  # machine code with data of its own, which only C modules have


@dataclass
class Code:
    """The code of a module or function, with that of the functions defined in it."""

    kind: int
    data: bytes
    children: list["Code"] = field(default_factory=list)


class Module:
    """A .mpy file, read.

    Attributes: raw, the file; architecture (a key of ARCHITECTURES, or "" for bytecode alone); constants,
    type and bytes of each; viper: name -> machine code of each viper function. Raises ValueError for what it
    cannot read.
    """

    def __init__(self, path: Path) -> None:
        self.raw = path.read_bytes()
        self._at = 4
        if self.raw[:2] != b"M\x06":
            raise ValueError(f"{path.name} is not a .mpy file of version 6")
        number = self.raw[2] >> 2
        self.architecture = next((name for name, n in ARCHITECTURES.items() if n == number), "")
        if number and not self.architecture:
            raise ValueError(f"{path.name} is for another architecture ({number})")
        n_names, n_constants = self._uint(), self._uint()
        self.names = [self._name() for _ in range(n_names)]
        self.constants = [self._constant() for _ in range(n_constants)]
        self.code = self._code()
        if self._at != len(self.raw):
            raise ValueError(f"{path.name} goes on after its end")
        self.viper = {
            name: self.code.children[i].data
            for i, name in self._defined().items()
            if self.code.children[i].kind == VIPER
        }

    def _take(self, n: int) -> bytes:
        self._at += n
        if self._at > len(self.raw):
            raise ValueError("the .mpy file is cut off")
        return self.raw[self._at - n : self._at]

    def _uint(self) -> int:
        number = 0
        while True:
            byte = self._take(1)[0]
            number = number << 7 | byte & 127
            if byte < 128:
                return number

    def _name(self) -> str | None:
        head = self._uint()
        return None if head & 1 else self._take((head >> 1) + 1)[:-1].decode()

    def _constant(self) -> tuple[int, bytes]:
        kind = self._take(1)[0]
        if kind in _EMPTY:
            return kind, b""
        return kind, self._take(self._uint() + (kind in _STRINGS))

    def _code(self) -> Code:
        head = self._uint()
        code = Code(head & 3, self._take(head >> 3))
        if code.kind == VIPER:
            if self._uint() & _FLAGS_OF_DATA:
                raise ValueError("machine code with data of its own is not understood")
        elif code.kind != BYTECODE:
            raise ValueError("of machine code, viper alone is understood")
        if head & 4:
            code.children = [self._code() for _ in range(self._uint())]
        return code

    def _defined(self) -> dict[int, str]:
        """The functions' names, from "make function i, store it as name j" in the module's code."""
        found = {}
        at = 0
        for i in range(len(self.code.children)):
            at = self.code.data.find(bytes((_MAKE_FUNCTION, i, _STORE_NAME)), at)
            if at < 0:
                raise ValueError("a function that is not stored under a name at once")
            name = self.names[self.code.data[at + 3]]
            found[i] = name if name is not None else f"function {i}"
            at += 4
        return found

"""What is in a .mpy file: MicroPython's compiled modules, version 6, with machine code in them.

The format, from the loader's side (a "uint" comes in groups of seven bits, the most significant first; all
but its last byte have bit 7 set):

    "M", 6, architecture << 2 | sub-version, bits of a small integer
    uint how many names, uint how many constants
    a name:      uint length << 1, its bytes and a zero; or uint number << 1 | 1, one of the interpreter's own
    a constant:  its type; None, False, True, ... and the table of helpers are only that, the others go on
                 with uint length and so many bytes (strings one more, a zero), a tuple so many constants
    the module's code, and in it that of each of its functions:
                 uint length << 3 | has children << 2 | kind, then so many bytes
                 viper: uint flags; inline assembler: uint flags, how many arguments, their types
                 has children: uint how many, then they

A viper function is machine code from its first byte on. It is called as C would call
`f(self, n_args, n_kw, args)` and finds through `self` the constants, through these the helpers. One in inline
assembler takes its arguments in registers, and knows nothing of the interpreter.
"""

from dataclasses import dataclass, field
from pathlib import Path

ARCHITECTURES = {"armv6m": 4, "armv7m": 5, "armv7emsp": 7}
BYTECODE, NATIVE, VIPER, ASSEMBLER = 0, 1, 2, 3
HELPERS = 0  # the type of the constant that stands for the interpreter's table of helpers
_EMPTY = range(5)  # that, None, False, True, ...
_STRINGS = (5, 6)
_TUPLE = 10
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
    type and bytes of each; viper, assembler: name -> machine code of each function of that kind. Raises
    ValueError for what it cannot read.
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
        self.viper = self._of_kind(VIPER)
        self.assembler = self._of_kind(ASSEMBLER)

    def _of_kind(self, kind: int) -> dict[str, bytes]:
        code = self.code.children
        return {name: code[i].data for i, name in self._defined().items() if code[i].kind == kind}

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
        n = self._uint()
        if kind == _TUPLE:
            return kind, b"".join(self._constant()[1] for _ in range(n))
        return kind, self._take(n + (kind in _STRINGS))

    def _code(self) -> Code:
        head = self._uint()
        code = Code(head & 3, self._take(head >> 3))
        if code.kind in (VIPER, ASSEMBLER):
            if self._uint() & _FLAGS_OF_DATA:
                raise ValueError("machine code with data of its own is not understood")
            if code.kind == ASSEMBLER:
                self._uint(), self._uint()
        elif code.kind != BYTECODE:
            raise ValueError("of machine code, viper and inline assembler are understood")
        if head & 4:
            code.children = [self._code() for _ in range(self._uint())]
        return code

    def _defined(self) -> dict[int, str]:
        """The functions' names, from "make function i, store it as name j" in the module's code."""
        found = {}
        at = 0
        for i, child in enumerate(self.code.children):
            here = self.code.data.find(bytes((_MAKE_FUNCTION, i, _STORE_NAME)), at)
            if here < 0:
                if child.kind == BYTECODE:
                    continue  # a class
                raise ValueError("a function that is not stored under a name at once")
            name = self.names[self.code.data[here + 3]]
            found[i] = name if name is not None else f"function {i}"
            at = here + 4
        return found

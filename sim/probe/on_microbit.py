"""Functions of the firmware on a micro:bit, compiled and run by its own interpreter.

Whatever is long goes through the debug port: source and constant tables into flash, as a programmer would put
them there, and the numbers of arrays in and out. The interpreter reads the source where it lies, and the
tables too, as on a board whose model is mapped into memory; all else is in its 9 KB of heap.
"""

import ast
import inspect
import struct
from array import array
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

from palpate.sim.probe.flat import Flattener
from palpate.sim.probe.microbit import RING, MicroBit, known_names

_FLASH = 0x3C000  # free in this firmware, but for its file system, which nobody uses here
_FLASH_END = 0x3FC00
_TEXT = 0x3F000  # where a function's source lies while it is compiled
_HELD = (2000, 1600, 1200, 800, 400)  # bytes; the first with which all else fits
_ITEMS = 12  # from an array object to its pointer to the numbers; before it stands how many


class Loaded:
    """Functions of the firmware on a micro:bit of their own.

    Parameters
    ----------
    examples : "module.function" -> arguments of one call, which say which arrays to make room for. Parameters
        of the same name share one array; none is later larger than here. "module.Class" makes an object,
        "module.Class.method" calls it.
    in_flash : names of parameters whose numbers never change, so that they lie in flash

    Raises ScriptFailed where it does not fit.
    """

    def __init__(self, examples: Mapping[str, Sequence[Any]], in_flash: frozenset[str] = frozenset()) -> None:
        for held in _HELD:
            self.bit = MicroBit()
            try:
                self._load(examples, in_flash, held)
                return
            except BaseException as failure:
                self.bit.close()
                if held == _HELD[-1] or "MemoryError" not in str(failure):
                    raise

    def __enter__(self) -> "Loaded":
        return self

    def __exit__(self, *_: object) -> None:
        self.bit.close()

    def _load(self, examples: Mapping[str, Sequence[Any]], in_flash: frozenset[str], held: int) -> None:
        bit = self.bit
        flat = Flattener(known_names())
        self._in_flash = in_flash
        self._flash_at = _FLASH
        self._arrays: dict[str, tuple[int, int]] = {}  # parameter -> address of its object, of its numbers
        self._held: dict[str, bytes] = {}
        self._parameters = {name: _parameters(name) for name in examples}
        shapes: dict[str, tuple[str, int]] = {}
        for name, arguments in examples.items():
            for parameter, argument in zip(self._parameters[name], arguments, strict=True):
                if isinstance(argument, array):
                    shapes[parameter] = argument.typecode, len(argument)
                elif isinstance(argument, bytes | bytearray):
                    shapes[parameter] = "B", len(argument)
        self._short = {parameter: flat.fresh() for parameter in shapes}
        self._lines = {name: self._line(flat, name) for name in examples}
        bit.run("import gc,micropython\nmicropython.opt_level(3)")
        bit.run("C=gc.collect\nfrom array import array")
        bit.run("S='a'*30\nS+='b'\nC()")
        self._text = int(bit.run("print(id(S))"))
        most = max(len(names) for names in self._parameters.values())
        self._values = self._array("V", "i", most)[1]
        for parameter, (typecode, length) in sorted(shapes.items(), key=lambda item: -item[1][1]):
            self._make_array(parameter, typecode, length)
        # nothing tidies up the heap: a piece is held free for what the lines and calls need
        bit.run(f"C()\nP=bytearray({held})")
        # the longest first, for their compilation needs most of the heap
        for piece in sorted(flat.pieces.values(), key=len, reverse=True):
            self._compile(piece)
        for short, numbers in flat.tables.items():
            bit.run(f"{short}=(0,)*{len(numbers)}")
            address = int(bit.run(f"print(id({short}))"))
            bit.port.write(address + 8, array("i", [2 * number + 1 for number in numbers]).tobytes())
        for name, line in self._lines.items():
            if len(line) >= RING:
                caller = flat.fresh()
                self._compile(f"def {caller}():{line}\n")
                self._lines[name] = f"{caller}()"
        bit.run("P=S=0\nC()")

    def _line(self, flat: Flattener, name: str) -> str:
        """What calls it and prints what it returns."""
        words = [self._short.get(p, f"V[{i}]") for i, p in enumerate(self._parameters[name])]
        parts = name.split(".")
        short = flat.add(".".join(parts[:2]))
        called = f"O.{parts[2]}" if len(parts) > 2 else short
        line = f"{called}({','.join(words)})"
        line = f"O={line}" if parts[-1][0].isupper() else f"print({line})"
        return line + ";C()"  # tidied up after each, so that it need not be in the middle of one

    def _compile(self, text: str) -> None:
        """Define what stands in `text`: the string S is made to point to it in flash."""
        data = text.encode()
        assert _TEXT + len(data) <= _FLASH_END
        self.bit.port.write(_TEXT, data)
        self.bit.port.write(self._text + 8, struct.pack("<II", len(data), _TEXT))
        self.bit.run("C()\nexec(S)")

    def _make_array(self, parameter: str, typecode: str, length: int) -> None:
        name = self._short[parameter]
        if parameter not in self._in_flash:
            self._arrays[parameter] = self._array(name, typecode, length)
            return
        size = length * struct.calcsize(typecode)
        assert self._flash_at + size <= _TEXT
        address, _ = self._array(name, typecode, 1)
        self.bit.port.write(address + _ITEMS, struct.pack("<I", self._flash_at))
        self._arrays[parameter] = address, self._flash_at
        self._flash_at += -(-size // 4) * 4

    def _array(self, name: str, typecode: str, length: int) -> tuple[int, int]:
        make = f"bytearray({length})" if typecode == "B" else f"array('{typecode}',range({length}))"
        self.bit.run(f"C()\n{name}={make}")
        return self._find(name)

    def _find(self, name: str) -> tuple[int, int]:
        """Address of an array and of its numbers."""
        address = int(self.bit.run(f"print(id({name}))"))
        return address, int.from_bytes(self.bit.port.read(address + _ITEMS, 4), "little")

    def call(self, name: str, *arguments: Any) -> int | None:
        """Call a function there. Arrays are changed as it changes them."""
        port = self.bit.port
        changing = {}
        for i, (parameter, argument) in enumerate(zip(self._parameters[name], arguments, strict=True)):
            if parameter not in self._arrays:
                port.write(self._values + 4 * i, struct.pack("<i", argument))
                continue
            data = bytes(argument)
            if self._held.get(parameter) != data:
                address, numbers = self._arrays[parameter]
                port.write(address + _ITEMS - 4, struct.pack("<I", len(argument)))
                port.write(numbers, data)
                self._held[parameter] = data
            if parameter not in self._in_flash and not isinstance(argument, bytes):
                changing[parameter] = argument
        said = self.bit.run(self._lines[name])
        for parameter, argument in changing.items():
            data = port.read(self._arrays[parameter][1], len(self._held[parameter]))
            memoryview(argument).cast("B")[:] = data
            self._held[parameter] = data
        return ast.literal_eval(said.strip() or "None")

    def attribute(self, name: str) -> int:
        """A number that the object keeps."""
        return int(self.bit.run(f"print(O.{name})"))

    def kept(self, name: str, n: int) -> bytes:
        """The first n bytes of an array that the object keeps."""
        return self.bit.port.read(self._find(f"O.{name}")[1], n)


def _parameters(name: str) -> list[str]:
    """Of "module.function", "module.Class" or "module.Class.method", without self."""
    module, *path = name.split(".")
    thing: Any = import_module(f"firmware_py.{module}")
    for part in path:
        thing = getattr(thing, part)
    return [p for p in inspect.signature(thing).parameters if p != "self"]

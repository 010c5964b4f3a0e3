"""The firmware's viper and assembler functions as machine code, on an emulated Cortex-M; mpy-cross compiles.

    code = MachineCode(Path("firmware_py/hot_viper.py"), "armv6m")
    code["put_cells"](packed, 0, cells, 0)

calls machine code with integers and buffers as MicroPython would and returns what it returns; the buffers
are changed as it changes them. The processor is the package unicorn's. What MicroPython itself does for the
code (arguments in, result out, floor division) is done here by the same rules, outside of that processor.

Each buffer ends where the memory ends: machine code that reads or writes behind one, which nothing on a
board would notice, is a BadAccess here.
"""

from array import array
from collections.abc import Callable
from pathlib import Path

import unicorn
from unicorn import arm_const as arm

from tests.sim.probe import mpy_file
from tests.sim.probe.viper_source import compile_viper, constants_of

Buffer = array | bytearray | bytes

PROCESSORS = {
    "armv6m": arm.UC_CPU_ARM_CORTEX_M0,
    "armv7m": arm.UC_CPU_ARM_CORTEX_M3,
    "armv7emsp": arm.UC_CPU_ARM_CORTEX_M4,
}

_CODE = 0x08000000  # the functions, one after the other
_TABLES = 0x10000000  # what they are given: self, context, constants, helpers, arguments
_HELPERS = 0x18000000  # where a call of the k-th helper goes: 4 k on
_STACK = 0x1FFF0000
_STACK_BYTES = 0x4000
_BUFFERS = 0x20000000
_BUFFER_BYTES = 0x20000  # the largest; as much between two of them is no memory at all
_RETURN = 0x18000800

_N_HELPERS = 128
_SELF, _CONTEXT, _CONSTANTS, _HELPER_TABLE, _ARGUMENTS, _NAMES = (_TABLES + 0x400 * k for k in range(6))

# helpers by their place in the interpreter's table
_NONE = 0
_FROM_OBJECT = 3
_TO_OBJECT = 4
_SWAP_GLOBALS = 5
_LOAD_GLOBAL = 7
_PUSH_HANDLER, _POP_HANDLER = 32, 33  # of exceptions, which a function with globals has; 0: go on
_CHECK_ARGUMENTS = 44
_FLOOR_DIVIDE = 46
_MODULO = 47
_INT, _UINT = 2, 3  # types of what a function takes and gives; 4 and more are pointers
_NONE_OBJECT = 0x1C000000
_BUFFER_OBJECT = 0x1D000000
_REGISTERS = (arm.UC_ARM_REG_R0, arm.UC_ARM_REG_R1, arm.UC_ARM_REG_R2, arm.UC_ARM_REG_R3)


class BadAccess(Exception):
    """Machine code touched memory that is not its own, or did what the processor does not know."""


def signed(word: int) -> int:
    """A word of 32 bits as a number with its sign."""
    return word - (word >> 31 << 32)


class MachineCode:
    """The viper functions of one source file on one processor: a mapping from their names to callables.

    Parameters
    ----------
    source : the Python file
    architecture : a key of PROCESSORS
    count : whether to count instructions (ten times slower)
    frozen : whether it lies as in a build of MicroPython that it is frozen into, which aligns it to two bytes
        only (tools/mpy-tool.py); as a .mpy file it is loaded to a multiple of four

    Attributes
    ----------
    instructions : how many were executed so far, if they are counted (on M3 and M4 those too that a condition
        skipped, which take a cycle as well)
    divisions : how many calls of MicroPython's floor division and modulo; their instructions are not counted
    """

    def __init__(self, source: Path, architecture: str, count: bool = False, frozen: bool = False) -> None:
        module = compile_viper(source, architecture)
        self.instructions = 0
        self.divisions = 0
        self._failure: Exception | None = None
        constants = constants_of(source)
        self._globals = [constants.get(name or "") for name in module.names]
        self._objects: list[tuple[int, int]] = []
        self._in_block: dict[tuple[int, int], int] = {}
        self._mapped = 0
        uc = self._uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        uc.ctl_set_cpu_model(PROCESSORS[architecture])
        for base, size in ((_TABLES, 0x2000), (_HELPERS, 0x1000), (_STACK, _STACK_BYTES)):
            uc.mem_map(base, size)
        self._functions = {}
        first = at = _CODE + (2 if frozen else 0)
        functions = {**module.viper, **module.assembler}
        for name, code in functions.items():
            self._functions[name] = self._callable(at, name in module.assembler)
            at += -(-len(code) // 4) * 4
        uc.mem_map(_CODE, -(-(at - _CODE) // 0x1000) * 0x1000)
        at = first
        for code in functions.values():
            uc.mem_write(at, code)
            at += -(-len(code) // 4) * 4
        self._words(_SELF, 0, _CONTEXT)
        self._words(_CONTEXT, 0, 0, _NAMES, _CONSTANTS)
        uc.mem_write(_NAMES, array("H", range(len(module.names))).tobytes())
        self._words(
            _CONSTANTS, *(_HELPER_TABLE if kind == mpy_file.HELPERS else 0 for kind, _ in module.constants)
        )
        self._words(_HELPER_TABLE, *(_HELPERS + 4 * k + 1 for k in range(_N_HELPERS)))
        self._words(_HELPER_TABLE + 4 * _NONE, _NONE_OBJECT)
        uc.mem_write(_HELPERS, b"\x70\x47\x00\xbf" * (0x1000 // 4))  # "return" everywhere
        uc.hook_add(unicorn.UC_HOOK_CODE, self._help, None, _HELPERS, _HELPERS + 4 * _N_HELPERS - 1)
        if count:
            uc.hook_add(unicorn.UC_HOOK_BLOCK, self._count, None, _CODE, at)

    def __getitem__(self, name: str) -> Callable[..., int | None]:
        return self._functions[name]

    def names(self) -> set[str]:
        """Of the functions."""
        return set(self._functions)

    def _words(self, at: int, *words: int) -> None:
        self._uc.mem_write(at, array("I", words).tobytes())

    def _callable(self, address: int, assembler: bool) -> Callable[..., int | None]:
        def function(*arguments: int | Buffer) -> int | None:
            return self._call(address, arguments, assembler)

        return function

    def _place(self, number: int) -> int:
        """The end of the memory for the number-th buffer."""
        base = _BUFFERS + 2 * _BUFFER_BYTES * number
        if number == self._mapped:
            self._uc.mem_map(base, _BUFFER_BYTES)
            self._mapped += 1
        return base + _BUFFER_BYTES

    def _call(self, address: int, arguments: tuple[int | Buffer, ...], assembler: bool) -> int | None:
        uc = self._uc
        words, buffers = [], []
        self._objects = []
        for argument in arguments:
            if isinstance(argument, int):
                if not -(2**30) <= argument < 2**30:
                    raise OverflowError(f"{argument} is no small integer")
                words.append((argument << 1 | 1) & 0xFFFFFFFF)
                continue
            data = bytes(argument)
            size = len(data)
            start = self._place(len(self._objects)) - size
            uc.mem_write(start, data)
            words.append(_BUFFER_OBJECT + 16 * len(self._objects))
            self._objects.append((start, size))
            if not isinstance(argument, bytes):
                buffers.append((start, size, argument))
        self._words(_ARGUMENTS, *words)
        self._failure = None
        in_registers = [_SELF, len(words), 0, _ARGUMENTS]
        if assembler:  # numbers as they are, buffers as where they lie
            in_registers = [signed(w) >> 1 if w & 1 else self._objects[w >> 4 & 15][0] for w in words]
        for register, word in zip(_REGISTERS, in_registers, strict=False):
            uc.reg_write(register, word & 0xFFFFFFFF)
        uc.reg_write(arm.UC_ARM_REG_SP, _STACK + _STACK_BYTES)
        uc.reg_write(arm.UC_ARM_REG_LR, _RETURN | 1)
        try:
            uc.emu_start(address | 1, _RETURN)
        except unicorn.UcError as error:
            pc = uc.reg_read(arm.UC_ARM_REG_PC)
            raise BadAccess(f"{error} at {pc - address:#x} of the function") from error
        if self._failure:
            raise self._failure
        for start, size, buffer in buffers:
            memoryview(buffer).cast("B")[:] = uc.mem_read(start, size)
        result = uc.reg_read(arm.UC_ARM_REG_R0)
        if assembler:
            return signed(result)
        if result == _NONE_OBJECT:
            return None
        if not result & 1:
            raise BadAccess(f"{result:#x} is no integer")
        return signed(result) >> 1

    def _help(self, uc: unicorn.Uc, address: int, size: int, _: object) -> None:
        """One of the interpreter's helpers is called; the machine code there only returns."""
        try:
            a, b = uc.reg_read(arm.UC_ARM_REG_R0), uc.reg_read(arm.UC_ARM_REG_R1)
            result = self._helper((address - _HELPERS) >> 2, a, b)
            uc.reg_write(arm.UC_ARM_REG_R0, result & 0xFFFFFFFF)
        except Exception as error:
            self._failure = error
            uc.emu_stop()

    def _helper(self, which: int, a: int, b: int) -> int:
        if which == _FROM_OBJECT:
            if a & 1:
                if b in (_INT, _UINT):
                    return signed(a) >> 1
            elif b > _UINT and a >= _BUFFER_OBJECT:
                return self._objects[(a - _BUFFER_OBJECT) >> 4][0]
            raise TypeError(f"object {a:#x} as type {b}")
        if which == _TO_OBJECT:
            if b != _INT or not -(2**30) <= signed(a) < 2**30:
                raise OverflowError(f"the result {signed(a)} would be put on the heap")
            return a << 1 | 1
        if which == _LOAD_GLOBAL:
            value = self._globals[a]
            if value is None:
                raise NameError(f"global {a} is no number of firmware_py")
            return value << 1 | 1
        if which in (_SWAP_GLOBALS, _PUSH_HANDLER, _POP_HANDLER):
            return 0
        if which in (_FLOOR_DIVIDE, _MODULO):
            self.divisions += 1
            quotient, rest = divmod(signed(a), signed(b))
            return quotient if which == _FLOOR_DIVIDE else rest
        if which == _CHECK_ARGUMENTS:
            raise TypeError("the function takes another number of arguments")
        raise NotImplementedError(f"helper {which}")

    def _count(self, uc: unicorn.Uc, address: int, size: int, _: object) -> None:
        """A piece of code without a branch in it is about to run."""
        n = self._in_block.get((address, size))
        if n is None:
            halves = array("H", bytes(uc.mem_read(address, size)))
            n = k = 0
            while k < len(halves):
                k += 2 if halves[k] >> 11 in (29, 30, 31) else 1  # Thumb's instructions of 32 bits
                n += 1
            self._in_block[address, size] = n
        self.instructions += n

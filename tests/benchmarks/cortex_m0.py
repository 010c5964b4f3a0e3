"""C on an emulated Cortex-M0+: compiled by arm-none-eabi-gcc, run by unicorn, its cycles by Arm's table.

    program = Program(folder, "model.c", source)
    out = program.run("once", {"in": data}, "out", 4)

The table is that of the Cortex-M0+ technical reference manual, 3.3, with the multiplier of one cycle and
memory without wait states. A branch that is not taken costs one cycle, one that is costs two.
"""

from __future__ import annotations

import shutil
import subprocess
from array import array
from collections.abc import Mapping
from pathlib import Path

import unicorn
from unicorn import arm_const as arm

COMPILER = "arm-none-eabi-gcc"
_CODE, _MEMORY, _RETURN = 0x08000000, 0x20000000, 0x0BFFFF00
_CODE_BYTES, _MEMORY_BYTES = 0x200000, 0x40000
_LAYOUT = """ENTRY(once)
SECTIONS {
  . = 0x08000000;
  .all : { *(.text*) *(.rodata*) *(.data*) *(.ARM*) }
  . = 0x20000000;
  .bss : { *(.bss*) *(COMMON) }
}
"""
_OPTIONS = "-mcpu=cortex-m0plus -mthumb -O2 -ffreestanding -nostartfiles -ffunction-sections -fdata-sections"
_LINKED = "-Wl,--gc-sections -Wl,-T,layout.ld"


class Unbuildable(Exception):
    """The compiler is missing, or does not take the source; the text says why."""


class Program:
    """C (or C++, by the suffix) with a function `once`, and global arrays by their names.

    Attributes
    ----------
    size : int
        Bytes of code and constants, with what the linker took from libraries.
    cycles : int
        Of the last run.
    """

    def __init__(self, folder: Path, name: str, source: str, include: str = "") -> None:
        if shutil.which(COMPILER) is None:
            raise Unbuildable(
                f"{COMPILER} is not installed (Debian's gcc-arm-none-eabi and libnewlib-arm-none-eabi)"
            )
        (folder / name).write_text(source)
        (folder / "layout.ld").write_text(_LAYOUT)
        more = "-fno-exceptions -fno-rtti" if name.endswith("pp") else "-std=c99"
        words = [COMPILER, *_OPTIONS.split(), *more.split(), *([f"-I{include}"] if include else [])]
        self._call([*words, "-o", "model.elf", name, *_LINKED.split(), "-lm", "-lgcc"], folder)
        self._call(["arm-none-eabi-objcopy", "-O", "binary", "-j", ".all", "model.elf", "model.bin"], folder)
        named = self._call(["arm-none-eabi-nm", "model.elf"], folder)
        self._places = {
            line.split()[-1]: int(line.split()[0], 16) for line in named.splitlines() if line[0] != " "
        }
        code = (folder / "model.bin").read_bytes()
        self.size = len(code)
        self.cycles = 0
        self._blocks: dict[tuple[int, int], tuple[int, int]] = {}
        self._end = 0
        self._far = 0
        uc = self._uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        uc.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M0)
        uc.mem_map(_CODE, _CODE_BYTES)
        uc.mem_map(_MEMORY, _MEMORY_BYTES)
        uc.mem_map(_RETURN & ~0xFFF, 0x1000)
        uc.mem_write(_CODE, code)
        uc.hook_add(unicorn.UC_HOOK_BLOCK, self._count, None, _CODE, _CODE + len(code))

    @staticmethod
    def _call(words: list[str], folder: Path) -> str:
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
        if done.returncode:
            raise Unbuildable((done.stderr.strip().splitlines() or ["it failed"])[0])
        return done.stdout

    def run(self, function: str, given: Mapping[str, bytes], out: str, size: int) -> bytes:
        """Call it with these arrays; `size` bytes of the array `out`."""
        for name, data in given.items():
            self._uc.mem_write(self._places[name], data)
        self._uc.reg_write(arm.UC_ARM_REG_SP, _MEMORY + _MEMORY_BYTES)
        self._uc.reg_write(arm.UC_ARM_REG_LR, _RETURN | 1)
        self.cycles, self._end = 0, self._places[function] & ~1
        self._uc.emu_start(self._places[function] | 1, _RETURN)
        return bytes(self._uc.mem_read(self._places[out], size))

    def _count(self, uc: unicorn.Uc, address: int, size: int, _: object) -> None:
        """A piece of code without a branch inside is about to run."""
        if (address, size) not in self._blocks:
            self._blocks[address, size] = _cycles(array("H", bytes(uc.mem_read(address, size))))
        if address != self._end:  # a branch was taken
            self.cycles += self._far
        spent, self._far = self._blocks[address, size]
        self.cycles += spent
        self._end = address + size


def _cycles(halves: array[int]) -> tuple[int, int]:
    """Of a piece of code, and what more its last instruction takes if it branches."""
    total, at, far = 0, 0, 1
    while at < len(halves):
        half = halves[at]
        far = 1
        if half >> 11 in (29, 30, 31):  # 32 bits: a call, or a barrier
            total, far, at = total + 1, 2, at + 2
            continue
        at += 1
        if half >> 9 in (0b1011010, 0b1011110) or half >> 12 == 0b1100:  # push, pop, stm, ldm
            total += 1 + (half & (0x1FF if half >> 12 == 0b1011 else 0xFF)).bit_count()
            far = 2
        elif half >> 11 == 0b01001 or half >> 12 in (0b0101, 0b0110, 0b0111, 0b1000, 0b1001):  # load, store
            total += 2
        else:
            total += 1
    return total, far

"""Which sensor array this program works with: firmware_py/sensor_array.py, or the file that is named instead.

    palpate --array small.py ...            or PALPATE_ARRAY=small.py for every program, Python's own included
    palpate --array 16x32@3mm,25kPa ...     rows x columns at their pitch, and full scale (25 kPa unless told)

The file is a copy of firmware_py/sensor_array.py with other numbers, the same that goes onto the probe. It is
read when the firmware's modules are first imported, by child processes too, and holds for the whole process.
"""

from __future__ import annotations

import ast
import atexit
import importlib.util
import os
import re
import shutil
import sys
import tempfile
from importlib.machinery import ModuleSpec
from pathlib import Path

from palpate.errors import NoSuchFile, UsageError
from palpate.files import read_limited

VARIABLE = "PALPATE_ARRAY"
HOME = "firmware_py.sensor_array"
LIMITS = {
    "ROWS": (6, 48),
    "COLUMNS": (8, 64),
    "PITCH_UM": (250, 8000),
    "FULL_SCALE_PA": (1000, 100_000),
    "PEDESTAL_PA": (0, 50_000),
}
MOST_CELLS = 1024
LEAST_REACH_UM = 8000
"""A feature looks 8 mm to either side of the face's middle."""
_WORDS = re.compile(r"(\d{1,3})x(\d{1,3})@(\d{1,2}(?:\.\d{1,3})?)mm(?:,(\d{1,3}(?:\.\d{1,3})?)kPa)?")
FULL_KPA = 25.0


def words_of(rows: int, columns: int, pitch_mm: float, full_kPa: float = FULL_KPA) -> str:
    """An array in the words that `--array` and PALPATE_ARRAY take."""
    return f"{rows}x{columns}@{pitch_mm:g}mm,{full_kPa:g}kPa"


def read(path: Path) -> dict[str, int]:
    """The numbers of a description, a file or words.

    Raises NoSuchFile, or UsageError with what is wrong with it.
    """
    if told := _WORDS.fullmatch(str(path)):
        rows, columns, pitch_mm, full_kPa = told.groups(str(FULL_KPA))
        found = (int(rows), int(columns), round(1000 * float(pitch_mm)), round(1000 * float(full_kPa)))
        return _checked(path, dict(zip(LIMITS, (*found, found[-1] // 50))))
    if "@" in str(path) and not path.exists():
        raise UsageError(f"{path} is no array: write rows x columns, pitch and full scale as 16x32@3mm,25kPa")
    try:
        tree = ast.parse(read_limited(path, 1 << 20).decode())
    except OSError as error:
        raise NoSuchFile(f"the array's description {path} cannot be read: {error.strerror}") from None
    except (SyntaxError, UnicodeDecodeError, ValueError, RecursionError, MemoryError):
        raise UsageError(f"{path} is no description of an array: copy firmware_py/sensor_array.py") from None
    numbers = {}
    for node in tree.body:
        match node:
            case ast.Expr(ast.Constant(str())):
                pass
            case ast.Assign([ast.Name(name)], ast.Constant(int() as number)) if name in LIMITS:
                numbers[name] = number
            case _:
                raise UsageError(
                    f"{path}, line {node.lineno}: a description holds whole numbers for {', '.join(LIMITS)}"
                )
    return _checked(path, numbers)


def _checked(path: Path, numbers: dict[str, int]) -> dict[str, int]:
    for name, (low, high) in LIMITS.items():
        if name not in numbers:
            raise UsageError(f"{path} does not say {name}")
        if not low <= numbers[name] <= high:
            raise UsageError(f"{path}: {name} must lie between {low} and {high}, not {numbers[name]}")
    rows, columns, pitch = (numbers[name] for name in ("ROWS", "COLUMNS", "PITCH_UM"))
    if rows % 2 or columns % 2 or rows * columns % 8 or rows * columns > MOST_CELLS:
        raise UsageError(
            f"{path}: rows and columns must be even, their product a multiple of 8 and at most {MOST_CELLS}, "
            f"not {rows} x {columns}"
        )
    if (rows - 1) * pitch < 2 * LEAST_REACH_UM:
        raise UsageError(
            f"{path}: {rows} rows at {pitch} um reach less than 8 mm to either side of the middle"
        )
    return numbers


def use(path: Path | str) -> None:
    """Work with this array from here on, in child processes too.

    Raises NoSuchFile, UsageError; also where the firmware's modules already know another array.
    """
    path = _named(str(path))
    wanted = read(path)
    _check_known(path, wanted)
    os.environ[VARIABLE] = str(path)
    watch()


def _named(text: str) -> Path:
    """Words as they are, a file wherever the process goes."""
    return Path(text) if _in_words(Path(text)) else Path(text).resolve()


def _in_words(path: Path) -> bool:
    return _WORDS.fullmatch(str(path)) is not None


def _check_known(path: Path, wanted: dict[str, int]) -> None:
    known = sys.modules.get(HOME)
    if known is not None and any(getattr(known, name) != number for name, number in wanted.items()):
        raise UsageError(f"{path} comes too late: import palpate before firmware_py")


class _Finder:
    """Puts the described array in the place of firmware_py/sensor_array.py."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """Of the named file, for that one module."""
        named = os.environ.get(VARIABLE)
        if name != HOME or not named:
            return None
        file = _named(named)
        numbers = read(file)
        if _in_words(file):
            file = _written(numbers)
            os.environ[VARIABLE] = str(file)  # for children; emulated probes read the file itself
        return importlib.util.spec_from_file_location(name, file)


def _written(numbers: dict[str, int]) -> Path:
    """A description of an array that was told in words, as long as this process lives."""
    folder = Path(tempfile.mkdtemp(prefix="palpate-array-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    file = folder / "sensor_array.py"
    file.write_text("".join(f"{name} = {number}\n" for name, number in numbers.items()))
    return file


def watch() -> None:
    """See to it that whoever imports the firmware gets the array that is named.

    Raises UsageError where somebody has imported it before, and got another.
    """
    if HOME in sys.modules and (named := os.environ.get(VARIABLE)):
        _check_known(Path(named), read(_named(named)))
    if _Finder not in sys.meta_path:
        sys.meta_path.insert(0, _Finder)

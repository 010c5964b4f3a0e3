"""The declaration: a small TOML file that says what somebody's frames are. Units as it names them.

rows = 8                      # along the stroke
columns = 12                  # across it
pitch_mm = 3.0                # or [along, across]
dead = [[0, 3]]               # cells (row, column) whose readings mean nothing
lift = false                  # the frames hold the air round a stroke; else some is put there

[pressure]
name = "p_{row}_{column}"     # the columns of a table; or one array of frames x rows x columns
unit = "kPa"                  # Pa, kPa, mbar, psi, N (a cell), counts
kPa_per_unit = 0.006          # of counts
zero = 0.0                    # what an unloaded cell reads, in the unit; or
zero_frames = 5               # the mean of so many frames at the beginning, cell by cell

[position]
name = "x"
unit = "mm"                   # um, mm, cm, m
# or, where there is none:  constant_mm_per_s = 60.0

[displacement]                # leave out where there is none
name = "z"
unit = "mm"

[time]                        # leave out where there is none, and say  frames_per_s = 37.5
name = "t"
unit = "s"                    # us, ms, s

[stroke]                      # leave out where a file is one stroke
name = "stroke"
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.errors import UsageError
from palpate.files import read_toml

LENGTHS = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1e3}
TIMES = {"us": 1e-6, "ms": 1e-3, "s": 1.0}
PRESSURES = {"Pa": 1e-3, "kPa": 1.0, "mbar": 0.1, "psi": 6.894757, "N": 0.0, "counts": 0.0}
"""kPa of one; N and counts need the cell's area and `kPa_per_unit`."""

MOST_CELLS = 1 << 16
MOST_FRAMES_PER_S = 10_000
_TABLES: dict[str, tuple[str, ...]] = {
    "pressure": ("name", "unit", "kPa_per_unit", "zero", "zero_frames"),
    "position": ("name", "unit", "constant_mm_per_s"),
    "displacement": ("name", "unit"),
    "time": ("name", "unit"),
    "stroke": ("name",),
}
_PLAIN = ("rows", "columns", "pitch_mm", "dead", "lift", "frames_per_s")


@dataclass(frozen=True)
class Declaration:
    """What frames are: their array, names and units.

    Attributes
    ----------
    rows, columns : int
        Along the stroke, and across it.
    pitch_mm : (float, float)
        Along and across.
    dead : tuple of (int, int)
    lift : bool
        Whether frames in the air are put before and after each stroke.
    pressure : str
        Name of the pressures; `{row}` and `{column}` in it stand for numbers from 0.
    kPa : float
        Of one unit.
    zero : float
        In the unit.
    zero_frames : int
        0: `zero` counts.
    position, displacement, time, stroke : str
        Names; "" where there is none.
    position_mm, displacement_mm, time_s : float
        What one unit is.
    constant_mm_per_s, frames_per_s : float
        Stand in for positions and times that are not there; 0: not said.
    """

    rows: int
    columns: int
    pitch_mm: tuple[float, float]
    dead: tuple[tuple[int, int], ...] = ()
    pressure: str = "p_{row}_{column}_kPa"
    kPa: float = 1.0
    zero: float = 0.0
    zero_frames: int = 0
    position: str = ""
    position_mm: float = 1.0
    constant_mm_per_s: float = 0.0
    displacement: str = ""
    displacement_mm: float = 1.0
    time: str = ""
    time_s: float = 1.0
    frames_per_s: float = 0.0
    stroke: str = ""
    lift: bool = True

    def cell_names(self, first: int = 0) -> list[str]:
        """The columns of a table that hold the cells, row by row; [] where the pressures are one array.

        Rows and columns are counted from `first`."""
        if "{row}" not in self.pressure:
            return []
        pairs = ((r + first, c + first) for r in range(self.rows) for c in range(self.columns))
        return [self.pressure.replace("{row}", str(r)).replace("{column}", str(c)) for r, c in pairs]


def read(path: str | Path) -> Declaration:
    """Read a declaration; `UsageError` says what is wrong with it, and where."""
    path = Path(path)
    said = read_toml(path, "declaration")
    try:
        return _declaration(said)
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from None


def _declaration(said: dict[str, Any]) -> Declaration:
    for name in said:
        if name not in (*_PLAIN, *_TABLES):
            raise UsageError(f"there is no {name!r}; there are {', '.join((*_PLAIN, *_TABLES))}")
    parts = {name: _part(said, name) for name in _TABLES}
    rows, columns = (_whole(said, name) for name in ("rows", "columns"))
    if rows * columns > MOST_CELLS:
        raise UsageError(f"{rows} x {columns} cells are more than {MOST_CELLS}")
    pitch = _pitch(said.get("pitch_mm"))
    pressure = parts["pressure"]
    name = str(pressure.get("name", "p_{row}_{column}_kPa"))
    if ("{row}" in name) != ("{column}" in name):
        raise UsageError("pressure.name holds both of {row} and {column}, or neither")
    position = parts["position"]
    if not position:
        raise UsageError("say where the probe was: [position] with a name, or with constant_mm_per_s")
    if ("name" in position) == ("constant_mm_per_s" in position):
        raise UsageError("[position] has a name, or constant_mm_per_s where there is none, and not both")
    steady = _number(position, "constant_mm_per_s", "position.constant_mm_per_s", 0.0)
    if "name" not in position and not steady:
        raise UsageError("position.constant_mm_per_s is above 0: at rest there is no stroke")
    rate = _number(said, "frames_per_s", "frames_per_s", 0.0)
    if rate > MOST_FRAMES_PER_S:
        raise UsageError(f"frames_per_s is {MOST_FRAMES_PER_S} at most, not {rate:g}")
    if "name" not in parts["time"] and rate <= 0:
        raise UsageError("say when the frames were taken: [time] with a name, or frames_per_s")
    return Declaration(
        rows,
        columns,
        pitch,
        _dead(said.get("dead", []), rows, columns),
        name,
        _kPa(pressure, pitch),
        _number(pressure, "zero", "pressure.zero", 0.0),
        int(_number(pressure, "zero_frames", "pressure.zero_frames", 0.0)),
        str(position.get("name", "")),
        _unit(position, "position", LENGTHS, "mm"),
        steady,
        str(parts["displacement"].get("name", "")),
        _unit(parts["displacement"], "displacement", LENGTHS, "mm"),
        str(parts["time"].get("name", "")),
        _unit(parts["time"], "time", TIMES, "s"),
        rate,
        str(parts["stroke"].get("name", "")),
        _flag(said, "lift", True),
    )


def _part(said: dict[str, Any], name: str) -> dict[str, Any]:
    part = said.get(name, {})
    if not isinstance(part, dict):
        raise UsageError(f"{name} is a table: write [{name}] on a line of its own")
    for key in part:
        if key not in _TABLES[name]:
            raise UsageError(f"[{name}] knows no {key!r}; it knows {', '.join(_TABLES[name])}")
    if part and name != "position" and "name" not in part and name != "pressure":
        raise UsageError(f"[{name}] needs a name")
    return part


def _flag(said: dict[str, Any], name: str, default: bool) -> bool:
    value = said.get(name, default)
    if not isinstance(value, bool):
        raise UsageError(f"{name} is true or false, not {value!r}")
    return value


def _whole(said: dict[str, Any], name: str) -> int:
    value = said.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or value < 2:
        raise UsageError(f"{name} is a whole number from 2 on, not {value!r}")
    return value


def _number(part: dict[str, Any], key: str, where: str, default: float) -> float:
    value = part.get(key, default)
    if not isinstance(value, int | float) or isinstance(value, bool) or not 0 <= value < 1e9:
        raise UsageError(f"{where} is a number from 0 on, not {value!r}")
    return float(value)


def _pitch(value: Any) -> tuple[float, float]:
    pair = value if isinstance(value, list) else [value, value]
    good = len(pair) == 2 and all(isinstance(v, int | float) and 0.1 <= v <= 50 for v in pair)
    if not good:
        raise UsageError(f"pitch_mm is a number from 0.1 to 50, or [along, across], not {value!r}")
    return float(pair[0]), float(pair[1])


def _unit(part: dict[str, Any], name: str, units: dict[str, float], default: str) -> float:
    unit = part.get("unit", default)
    if not isinstance(unit, str) or unit not in units:
        raise UsageError(f"{name}.unit is one of {', '.join(units)}, not {unit!r}")
    return units[unit]


def _kPa(pressure: dict[str, Any], pitch: tuple[float, float]) -> float:
    scale = _unit(pressure, "pressure", PRESSURES, "kPa")
    unit = pressure.get("unit", "kPa")
    if unit == "N":
        return 1e3 / (pitch[0] * pitch[1])
    if unit == "counts":
        if not _number(pressure, "kPa_per_unit", "pressure.kPa_per_unit", 0.0):
            raise UsageError("counts need pressure.kPa_per_unit: how many kPa one count is")
        return float(pressure["kPa_per_unit"])
    if "kPa_per_unit" in pressure:
        raise UsageError(f"pressure.kPa_per_unit goes with the unit counts, not with {unit}")
    return scale


def _dead(cells: Any, rows: int, columns: int) -> tuple[tuple[int, int], ...]:
    out = []
    for cell in cells if isinstance(cells, list) else [cells]:
        good = isinstance(cell, list) and len(cell) == 2 and all(isinstance(v, int) for v in cell)
        if not good or not (0 <= cell[0] < rows and 0 <= cell[1] < columns):
            raise UsageError(f"dead: {cell!r} is not a [row, column] of {rows} x {columns} cells, from 0")
        out.append((cell[0], cell[1]))
    return tuple(out)

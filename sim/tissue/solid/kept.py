"""A set of solid strokes kept as one compact file, so that nobody needs the hours that it took.

A Parquet table with a row per stroke: its code (which is the whole case), displacements as float32, images
and those of the press-in ramp as whole numbers of pascals. An image is kept as differences, from position to
position, row to row and column to column, and by its left half where the right one mirrors it: a third of the
bytes. The recipe (design, settings, solver's version) and a hash of the rows, pascals and all, travel in the
table's metadata. Units: mm, kPa; pascals in the file.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.face_sensors import ACROSS, ALONG
from palpate.sim.tissue.settings import SOLID_SOLVER_VERSION, Settings
from palpate.sim.tissue.solid.result import SolidStroke
from palpate.sim.tissue.tables import iterate_strokes

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]

_META = b"palpate"
_MOST_PA = 65535
_CODING = "differences of int32"
_HALF = (ACROSS + 1) // 2
_IMAGES = ("images_Pa", "ramp_images_Pa")

SCHEMA = pa.schema(
    [
        pa.field("code", pa.string()),
        pa.field("displacement_mm", pa.list_(pa.float32())),
        pa.field("images_Pa", pa.list_(pa.int32())),
        pa.field("ramp_N", pa.list_(pa.float64())),
        pa.field("ramp_displacement_mm", pa.list_(pa.float32())),
        pa.field("ramp_images_Pa", pa.list_(pa.int32())),
    ]
)


@dataclass(frozen=True)
class KeptStroke:
    """One stroke of a kept set.

    Attributes
    ----------
    case : Case
    positions_mm, displacement_mm : ndarray (n,)
    images_kPa : ndarray (n, 16, 26)
        To the pascal.
    ramp_N, ramp_displacement_mm, ramp_images_kPa : ndarray (k,), (k,), (k, 16, 26)
        Smaller forces at the first position, while pressing in.
    """

    case: Case
    positions_mm: Floats
    displacement_mm: Floats
    images_kPa: Floats
    ramp_N: Floats
    ramp_displacement_mm: Floats
    ramp_images_kPa: Floats


def keep(sweep_dir: str | Path, path: str | Path, design: str, settings: Settings | None = None) -> int:
    """Write the solid strokes of a finished sweep to `path`; returns how many there are.

    Parameters
    ----------
    design : str
        What the sweep was given, for the recipe.

    Raises
    ------
    CaseError
        There are none, or they do not share their positions.
    """
    strokes = [s for s in iterate_strokes(sweep_dir) if isinstance(s, SolidStroke)]
    if not strokes:
        raise CaseError(f"{sweep_dir} holds no strokes over solid lumps; run a sweep of balls into it first")
    places = strokes[0].positions_mm
    if any(not np.array_equal(s.positions_mm, places) for s in strokes):
        raise CaseError(f"the strokes in {sweep_dir} stop at different positions; keep sweeps apart")
    write_kept(strokes, path, {"design": design, "settings": asdict(settings or Settings())})
    return len(strokes)


def write_kept(strokes: Sequence[SolidStroke | KeptStroke], path: str | Path, recipe: dict[str, Any]) -> None:
    """Write strokes that share their positions, with what they were made from."""
    rows = [_row(stroke) for stroke in strokes]
    recipe = {
        **recipe,
        "solver": SOLID_SOLVER_VERSION,
        "positions_mm": strokes[0].positions_mm.tolist(),
        "strokes": len(rows),
        "images": _CODING,
        "sha256": _hash(rows),
    }
    coded = [row | {name: _differences(row[name]) for name in _IMAGES} for row in rows]
    columns = [pa.array([row[field.name] for row in coded], field.type) for field in SCHEMA]
    table = pa.Table.from_arrays(columns, SCHEMA.names)
    table = table.replace_schema_metadata({_META: json.dumps(recipe).encode()})
    pq.write_table(table, path, compression="zstd", compression_level=19, use_dictionary=["code"])


def read_recipe(path: str | Path) -> dict[str, Any]:
    """What a kept set was made from.

    Raises
    ------
    CaseError
        The file is no kept set.
    """
    try:
        meta = pq.read_schema(path).metadata or {}
        recipe: dict[str, Any] = json.loads(meta[_META])
    except (OSError, KeyError, ValueError, pa.ArrowInvalid):
        raise CaseError(f"{path} is not a kept set of strokes") from None
    return recipe


def read_kept(path: str | Path) -> list[KeptStroke]:
    """The strokes of a kept set.

    Raises
    ------
    CaseError
        The file is no kept set, or not what was written.
    """
    recipe = read_recipe(path)
    if recipe.get("images") != _CODING:
        raise CaseError(f"{path} was kept by an earlier version; palpate sweep --keep makes it anew")
    try:
        rows = _rows(pq.read_table(path, schema=SCHEMA))
    except (OSError, ValueError, pa.ArrowInvalid):
        raise CaseError(f"{path} is damaged") from None
    if _hash(rows) != recipe["sha256"]:
        raise CaseError(f"{path} is damaged: its strokes are not those that its recipe tells of")
    places = np.array(recipe["positions_mm"])
    return [
        KeptStroke(
            case=Case.from_code(row["code"]),
            positions_mm=places,
            displacement_mm=row["displacement_mm"].astype(float),
            images_kPa=_images(row["images_Pa"]),
            ramp_N=row["ramp_N"],
            ramp_displacement_mm=row["ramp_displacement_mm"].astype(float),
            ramp_images_kPa=_images(row["ramp_images_Pa"]),
        )
        for row in rows
    ]


def _row(stroke: SolidStroke | KeptStroke) -> dict[str, Any]:
    return {
        "code": stroke.case.code,
        "displacement_mm": stroke.displacement_mm.astype(np.float32),
        "images_Pa": _pascals(stroke.images_kPa),
        "ramp_N": stroke.ramp_N,
        "ramp_displacement_mm": stroke.ramp_displacement_mm.astype(np.float32),
        "ramp_images_Pa": _pascals(stroke.ramp_images_kPa),
    }


def _rows(table: pa.Table) -> list[dict[str, Any]]:
    parts: dict[str, list[Any]] = {"code": table["code"].to_pylist()}
    for name in SCHEMA.names[1:]:
        lists = table[name].combine_chunks()
        starts = lists.offsets.to_numpy() - lists.offsets[0].as_py()
        parts[name] = np.split(lists.flatten().to_numpy(), starts[1:-1])
    rows = [dict(zip(parts, row, strict=True)) for row in zip(*parts.values(), strict=True)]
    for row in rows:
        for name, at in zip(_IMAGES, ("displacement_mm", "ramp_N"), strict=True):
            row[name] = _from_differences(row[name], len(row[at]))
    return rows


def _pascals(images_kPa: Floats) -> Integers:
    return np.clip(np.rint(1000.0 * images_kPa), 0, _MOST_PA).astype(np.int32).ravel()


def _differences(pascals: Integers) -> Integers:
    images = pascals.reshape(-1, ALONG, ACROSS)
    if np.array_equal(images, images[:, :, ::-1]):
        images = images[:, :, :_HALF]
    for axis in range(3):
        images = np.diff(images, axis=axis, prepend=np.int32(0))
    return images.ravel()


def _from_differences(differences: Integers, places: int) -> Integers:
    images = differences.reshape(places, ALONG, -1 if len(differences) else ACROSS)
    for axis in range(3):
        images = np.cumsum(images, axis=axis, dtype=np.int32)
    if images.shape[2] == _HALF:
        images = np.concatenate((images, images[:, :, ACROSS - _HALF - 1 :: -1]), axis=2)
    return images.ravel()


def _images(pascals: Integers) -> Floats:
    return pascals.reshape(-1, ALONG, ACROSS) / 1000.0


def _hash(rows: Iterable[dict[str, Any]]) -> str:
    total = hashlib.sha256()
    for row in rows:
        total.update(row["code"].encode())
        for name in SCHEMA.names[1:]:
            total.update(row[name].astype(row[name].dtype.newbyteorder("<")).tobytes())
    return total.hexdigest()

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
from collections.abc import Iterable
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

_META = b"palpate"
_MOST_PA = 65535
_CODING = "differences"
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
    rows = [_row(stroke) for stroke in strokes]
    recipe = {
        "design": design,
        "settings": asdict(settings or Settings()),
        "solver": SOLID_SOLVER_VERSION,
        "positions_mm": places.tolist(),
        "strokes": len(rows),
        "images": _CODING,
        "sha256": _hash(rows),
    }
    coded = [row | {name: _differences(row[name]) for name in _IMAGES} for row in rows]
    table = pa.Table.from_pylist(coded, SCHEMA).replace_schema_metadata({_META: json.dumps(recipe).encode()})
    pq.write_table(table, path, compression="zstd", compression_level=19, use_dictionary=["code"])
    return len(rows)


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
    try:
        rows = pq.read_table(path, schema=SCHEMA).to_pylist()
        if recipe.get("images") == _CODING:  # sets of earlier versions have the pascals themselves
            for row in rows:
                along = {"images_Pa": row["displacement_mm"], "ramp_images_Pa": row["ramp_N"]}
                row.update({name: _from_differences(row[name], len(at)) for name, at in along.items()})
    except (OSError, ValueError, pa.ArrowInvalid):
        raise CaseError(f"{path} is damaged") from None
    if _hash(rows) != recipe["sha256"]:
        raise CaseError(f"{path} is damaged: its strokes are not those that its recipe tells of")
    places = np.array(recipe["positions_mm"])
    return [
        KeptStroke(
            case=Case.from_code(row["code"]),
            positions_mm=places,
            displacement_mm=np.array(row["displacement_mm"]),
            images_kPa=_images(row["images_Pa"]),
            ramp_N=np.array(row["ramp_N"]),
            ramp_displacement_mm=np.array(row["ramp_displacement_mm"]),
            ramp_images_kPa=_images(row["ramp_images_Pa"]),
        )
        for row in rows
    ]


def _row(stroke: SolidStroke) -> dict[str, Any]:
    return {
        "code": stroke.code,
        "displacement_mm": stroke.displacement_mm.astype(np.float32).tolist(),
        "images_Pa": _pascals(stroke.images_kPa),
        "ramp_N": stroke.ramp_N.tolist(),
        "ramp_displacement_mm": stroke.ramp_displacement_mm.astype(np.float32).tolist(),
        "ramp_images_Pa": _pascals(stroke.ramp_images_kPa),
    }


def _pascals(images_kPa: Floats) -> list[int]:
    whole: list[int] = np.clip(np.rint(1000.0 * images_kPa), 0, _MOST_PA).astype(int).ravel().tolist()
    return whole


def _differences(pascals: list[int]) -> list[int]:
    images = np.array(pascals, np.int64).reshape(-1, ALONG, ACROSS)
    if np.array_equal(images, images[:, :, ::-1]):
        images = images[:, :, :_HALF]
    for axis in range(3):
        images = np.diff(images, axis=axis, prepend=0)
    flat: list[int] = images.ravel().tolist()
    return flat


def _from_differences(differences: list[int], places: int) -> list[int]:
    images = np.array(differences, np.int64).reshape(places, ALONG, -1 if differences else ACROSS)
    for axis in range(3):
        images = np.cumsum(images, axis=axis)
    if images.shape[2] == _HALF:
        images = np.concatenate((images, images[:, :, ACROSS - _HALF - 1 :: -1]), axis=2)
    pascals: list[int] = images.ravel().tolist()
    return pascals


def _images(pascals: list[int]) -> Floats:
    return np.array(pascals, float).reshape(-1, ALONG, ACROSS) / 1000.0


def _hash(rows: Iterable[dict[str, Any]]) -> str:
    total = hashlib.sha256()
    for row in rows:
        total.update(json.dumps(row, sort_keys=True, separators=(",", ":")).encode())
    return total.hexdigest()

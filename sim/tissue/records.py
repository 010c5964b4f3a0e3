"""A stroke as a row of a sweep's table."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import pyarrow as pa

from palpate.sim.tissue.case import SOLID_FIELDS, Case
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.layers import DEEPER, fields_of
from palpate.sim.tissue.result import Stroke

Record = dict[str, Any]

_LISTS = (
    "positions_mm",
    "displacement_mm",
    "images_kPa",
    "peak_mm",
    "peak_kPa",
    "contact_mm",
    "force_error",
    "smallest_jacobian",
    "iterations",
)
_SOLID_LISTS = ("peak_across_mm", "ramp_N", "ramp_displacement_mm", "ramp_images_kPa")
_UNSAID_NUMBERS = ("padding_mm_per_kPa", *(name for layer in DEEPER for name in fields_of(layer)))
_UNSAID = ("law", *_UNSAID_NUMBERS)
"""What a case without it leaves out of its row."""
_PLANE_FIELDS = tuple(f.name for f in fields(Case) if f.name not in (*SOLID_FIELDS, *_UNSAID))
SCHEMA = pa.schema(
    [(name, pa.string()) for name in ("key", "code", "status", "reason")]
    + [(name, pa.float64()) for name in _PLANE_FIELDS]
    + [("t_mm", pa.float64()), ("F_N_per_m", pa.float64())]
    + [(name, pa.list_(pa.float64())) for name in _LISTS[:-1]]
    + [
        ("iterations", pa.list_(pa.int32())),
        ("factorisations", pa.int32()),
        ("nodes", pa.int32()),
        ("law", pa.string()),
    ]
    + [(name, pa.float64()) for name in _UNSAID_NUMBERS]
)
SOLID_SCHEMA = pa.schema(
    list(SCHEMA)
    + [pa.field("shape", pa.string())]
    + [pa.field(name, pa.float64()) for name in SOLID_FIELDS if name != "shape"]
    + [pa.field(name, pa.list_(pa.float64())) for name in _SOLID_LISTS]
)
"""For tables with balls or ellipsoids in them; a cylinder's row has nothing in the columns that are
theirs."""


def record_of(key: str, case: Case, result: Stroke | Exception) -> Record:
    """One row of the table, and the CPU time beside it."""
    record: Record = {
        "key": key,
        "code": case.code,
        **case.to_dict(),
        "t_mm": case.t_mm,
        "F_N_per_m": case.F_N_per_m,
    }
    if not isinstance(result, Stroke):
        empty: Record = {name: [] for name in (*_LISTS, *(_SOLID_LISTS if case.solid else ()))}
        return (
            record
            | empty
            | {"status": "failed", "reason": str(result), "factorisations": 0, "nodes": 0, "cpu_s": 0.0}
        )
    lists = (*_LISTS, *_SOLID_LISTS) if case.solid else _LISTS
    record |= {name: getattr(result, name).ravel().tolist() for name in lists}
    record |= {"status": "ok", "reason": "", "factorisations": result.factorisations, "nodes": result.nodes}
    return record | {"cpu_s": result.cpu_s}


def stroke_of(record: Record) -> Stroke:
    """The stroke of a row whose status is `ok`; `CaseError` if another version of us wrote it."""
    try:
        solid = record.get("shape") is not None
        record = {"fat_mm": None, **record}  # which a cylinder has not always had
        case = {name: record[name] for name in (*_PLANE_FIELDS, *(SOLID_FIELDS if solid else ()))}
        case |= {name: record[name] for name in _UNSAID if record.get(name) is not None}
        whole = {**record, "case": case, "cpu_s": record.get("cpu_s", 0.0)}
        if solid:
            from palpate.sim.tissue.solid.result import SolidStroke

            return SolidStroke.from_dict(whole)
        return Stroke.from_dict(whole)
    except KeyError as missing:
        raise CaseError(
            f"the sweep was stored by another version (it lacks {missing.args[0]}); "
            "run palpate sweep again with the same --out"
        ) from None

"""What a recording holds: topics, their JSON schemas (which Foxglove shows) and how an event becomes JSON.

Two topics carry the wire itself, byte for byte; they alone are enough to replay. The others are the same
session decoded, for people and other programs. Units: mm, kPa, N/m, us; images in Pa (16 bit).

Source of the schemas `foxglove.RawImage` and `foxglove.Log`: Foxglove's documentation of well-known schemas.
"""

from __future__ import annotations

import json
from base64 import b64encode
from typing import Any

import numpy as np

from firmware_py import geometry, tables
from palpate.wire.events import (
    OUTPUTS,
    Boot,
    Estimate,
    Event,
    Features,
    Frame,
    Gap,
    Log,
    StrokeState,
    TactileMap,
)

_SIZE = (geometry.COLUMNS, geometry.ROWS, 2 * geometry.COLUMNS)
_PA_TO_MEAN_KPA = 1000 * geometry.CELLS
_MORE = [name.encode() for name in tables.FRAME_MORE]

WIRE_IN = "/wire/probe_to_host"
WIRE_OUT = "/wire/host_to_probe"
WIRES = (WIRE_IN, WIRE_OUT)
WIRE_ENCODING = "palpate-wire"
IMAGE, MOTION, STROKE, MAP, FEATURES, ESTIMATE, LOG, LINK = (
    "/image", "/motion", "/stroke", "/map", "/features", "/estimate", "/log", "/link",
)  # fmt: skip
MODEL, CALIBRATION = "model.palp", "calibration.bin"
"""Names of a recording's attachments: what the probe computed with."""
IMPORT_NOTE = "import"
"""Name of a recording's metadata in which `palpate import` says what was missing."""

_NUMBER = {"type": "number"}
_INTEGER = {"type": "integer"}
_TEXT = {"type": "string"}
_FLAG = {"type": "boolean"}
_NUMBERS = {"type": "array", "items": _NUMBER}
_TIME = {"type": "object", "title": "time", "properties": {"sec": _INTEGER, "nsec": _INTEGER}}
_BOUND = {"type": ["number", "null"]}
_BOUNDED = {"type": "object", "properties": {"value": _NUMBER, "low": _NUMBER, "high": _NUMBER}}

SCHEMAS: dict[str, tuple[str, dict[str, Any]]] = {
    IMAGE: (
        "foxglove.RawImage",
        {
            "timestamp": _TIME,
            "frame_id": _TEXT,
            "width": _INTEGER,
            "height": _INTEGER,
            "encoding": _TEXT,
            "step": _INTEGER,
            "data": {"type": "string", "contentEncoding": "base64"},
        },
    ),
    MOTION: (
        "palpate.Motion",
        {
            "seq": _INTEGER,
            "time_us": _INTEGER,
            "position_mm": _NUMBER,
            "displacement_mm": _NUMBER,
            "pressure_mean_kPa": _NUMBER,
            "lost_before": _INTEGER,
            **dict.fromkeys(tables.FRAME_MORE, _INTEGER),
        },
    ),
    STROKE: (
        "palpate.StrokeState",
        {"stroke": _INTEGER, "state": _TEXT, "time_us": _INTEGER, "frame_seq": _INTEGER, "value": _INTEGER},
    ),
    MAP: (
        "palpate.TactileMap",
        {
            "stroke": _INTEGER,
            "x_mm": _NUMBERS,
            "pressure_kPa": _NUMBERS,
            "base_kPa": _NUMBER,
            "amplitude_kPa": _NUMBER,
            "centre_mm": _NUMBER,
            "stdev_mm": _NUMBER,
            "status": _INTEGER,
        },
    ),
    FEATURES: ("palpate.Features", {"stroke": _INTEGER, "version": _INTEGER, "q24": _NUMBERS}),
    ESTIMATE: (
        "palpate.Estimate",
        {
            "stroke": _INTEGER,
            **dict.fromkeys((*OUTPUTS, "depth_mm"), _BOUNDED),
            "E_ratio": {"type": "object", "properties": dict.fromkeys(("value", "low", "high"), _BOUND)},
            "lump": _FLAG,
            "hardness": _TEXT,
            "in_domain": _FLAG,
            "level": _NUMBER,
            "model_id": _TEXT,
            "valid": _FLAG,
            "reason": _TEXT,
        },
    ),
    LOG: (
        "foxglove.Log",
        {
            "timestamp": _TIME,
            "level": _INTEGER,
            "message": _TEXT,
            "name": _TEXT,
            "file": _TEXT,
            "line": _INTEGER,
        },
    ),
    LINK: ("palpate.Link", {"event": _TEXT, "seconds": _NUMBER, "reason": _TEXT, "restarted": _FLAG}),
}
"""Topic -> name of its schema and the properties of its JSON object."""

TOPICS = (*WIRES, *SCHEMAS)
BY_ID = dict(enumerate(TOPICS, 1))
"""A recording's channels: number -> topic. They are the same in all, so that no damage can hide them."""

_FOXGLOVE_LEVEL = (2, 3, 4)  # info, warning, error


def schema_json(topic: str) -> tuple[str, bytes]:
    """Name and JSON schema of a topic."""
    name, properties = SCHEMAS[topic]
    text = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": name, "type": "object"}
    return name, json.dumps({**text, "properties": properties}).encode()


def read_json(data: bytes) -> dict[str, Any]:
    """A message of a decoded topic; {} where it is no JSON object: recordings come from anywhere."""
    try:
        told = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return told if isinstance(told, dict) else {}


def device_time_us(event: Event) -> int | None:
    """The probe's own time of an event, us, unwrapped, where it has one."""
    return getattr(event, "time_us", None)


def decoded(event: Event) -> list[tuple[str, bytes]]:
    """An event as messages of the decoded topics: (topic, JSON)."""
    if type(event) is Frame:
        return _frame(event)
    if isinstance(event, Estimate):
        return [(ESTIMATE, _json(event.as_dict()))]
    if isinstance(event, StrokeState):
        words = {"stroke": event.stroke, "state": event.state, "time_us": event.time_us}
        return [(STROKE, _json({**words, "frame_seq": event.frame_seq, "value": event.value}))]
    if isinstance(event, TactileMap):
        return [(MAP, _json(event.as_dict()))]
    if isinstance(event, Features):
        return [(FEATURES, _json({"stroke": event.stroke, "version": event.version, "q24": event.values}))]
    if isinstance(event, Log):
        words = {"timestamp": _time(event.host_ns), "level": _FOXGLOVE_LEVEL[min(event.level, 2)]}
        return [(LOG, _json({**words, "message": event.text, "name": "probe", "file": "", "line": 0}))]
    if isinstance(event, Gap):
        words = {"event": "up" if event.ended else "down", "seconds": event.seconds, "reason": event.reason}
        return [(LINK, _json({**words, "restarted": event.restarted}))]
    if isinstance(event, Boot):
        return [(LINK, _json({"event": "boot", "seconds": 0.0, "reason": f"start {event.boots}"}))]
    return []


def _frame(event: Frame) -> list[tuple[str, bytes]]:
    """The hot path: written as text at once, five times as fast as `json.dumps` of a dict."""
    pascal = np.rint(1000 * event.pressure_kPa).clip(0, 65535).astype("<u2")
    second, nanosecond = divmod(event.host_ns, 1_000_000_000)
    image = (
        b'{"timestamp":{"sec":%d,"nsec":%d},"frame_id":"probe","width":%d,"height":%d,'
        b'"encoding":"mono16","step":%d,"data":"%b"}'
        % (second, nanosecond, *_SIZE, b64encode(pascal.tobytes()))
    )
    motion = (
        b'{"seq":%d,"time_us":%d,"position_mm":%.3f,"displacement_mm":%.3f,'
        b'"pressure_mean_kPa":%.4f,"lost_before":%d%b}'
        % (
            event.seq,
            event.time_us,
            event.position_um * 1e-3,
            event.displacement_um * 1e-3,
            pascal.sum(dtype=np.int64) / _PA_TO_MEAN_KPA,
            event.lost_before,
            b"".join(b',"%b":%d' % told for told in zip(_MORE, event.more)),
        )
    )
    return [(IMAGE, image), (MOTION, motion)]


def _time(ns: int) -> dict[str, int]:
    return {"sec": ns // 1_000_000_000, "nsec": ns % 1_000_000_000}


def _json(value: dict[str, Any]) -> bytes:
    return json.dumps(value, allow_nan=False).encode()

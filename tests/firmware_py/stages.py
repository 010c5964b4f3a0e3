"""Strokes and force maps on which runtimes are compared, and what the pipeline makes of them."""

import struct
from collections.abc import Iterator

import numpy as np

from firmware_py import calib, forcemap
from palpate.firmware_twin.replay_core import Replay
from palpate.sim.probe.sensors import LEVELS, FrameStream, SensorModel, StrokeField
from tests.firmware_py import checked_int
from tests.firmware_py.strokes import read_strokes


def any_force_map() -> bytes:
    """A force map for proofs: random coefficients as large as a fitted one's."""
    random = np.random.default_rng(5)
    blob = bytearray(forcemap.BLOB_BYTES)
    blob[0], blob[1], blob[2] = 0x46, forcemap.VERSION, 12
    struct.pack_into("<ii", blob, 4, 78_000_000, 19_000_000)
    struct.pack_into(f"<{forcemap.COEFS}h", blob, 12, *random.integers(-300, 300, forcemap.COEFS).tolist())
    return bytes(blob)


def strokes(n: int, frames: int) -> Iterator[tuple[FrameStream, calib.Calibration]]:
    """n strokes over lumps, balls and nothing, through sensors from good to poor, with their calibrations."""
    fields = [StrokeField(*pair) for pair in read_strokes()]
    for seed in range(n):
        level = ("good", "typical", "poor")[seed // len(fields) % 3]
        across_mm = 4.0 if seed % 5 == 1 else None
        model = SensorModel(
            fields[seed % len(fields)], LEVELS[level], seed, across_mm=across_mm, travel_mm=76.0
        )
        yield model.stroke(frames), model.calibration()


def replayed(replay: Replay, model: SensorModel, n_frames: int = 50, **kwargs) -> tuple[FrameStream, int]:
    """A stroke of these sensors, and the pipeline's status of it."""
    frames = model.stroke(n_frames, **kwargs)
    return frames, replay.stream(frames, model.calibration())


def told(stream: FrameStream, calibration: calib.Calibration) -> list:
    """What the firmware's own modules make of a stroke, with whatever stands in their places by now."""
    replay = Replay(any_force_map(), plain=True)
    code, p = replay.stream(stream, calibration), replay.pipeline
    return [code, p.n, p.stuck, *map(list, (p.features, p.map, p.fit, p.span, p.columns, p.profile))]


def watched(map_blob: bytes | None = None) -> tuple[Replay, checked_int.Watch]:
    """A pipeline of which every intermediate is watched, and the watch."""
    modules, watch = checked_int.load()
    replay = Replay(plain=True)
    replay.force_map = map_blob and modules.forcemap.load(map_blob)
    replay.pipeline = modules.pipeline.Pipeline(calib.Calibration())
    return replay, watch

"""The pipeline's and the evaluator's functions as they are called in real strokes.

Arguments, and what came out.
"""

import copy
import importlib
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware_py import calib, forcemap
from palpate.sim.probe.sensors import LEVELS, FrameStream, SensorModel, StrokeField
from tests.firmware_py.strokes import read_strokes


@dataclass
class Call:
    """One call: the arguments before it, what it returned, the arguments after it."""

    before: tuple[Any, ...]
    returned: Any
    after: tuple[Any, ...]


@contextmanager
def recorded(*names: str, most: int = 100) -> Iterator[dict[str, list[Call]]]:
    """Record the first `most` calls of each "module.function" of firmware_py for as long as this lasts."""
    calls: dict[str, list[Call]] = {name: [] for name in names}
    originals: list[tuple[Any, str, Callable]] = []

    def wrap(name: str, original: Callable) -> Callable:
        def wrapper(*args: Any) -> Any:
            if len(calls[name]) >= most:
                return original(*args)
            before = copy.deepcopy(args)
            returned = original(*args)
            calls[name].append(Call(before, returned, copy.deepcopy(args)))
            return returned

        return wrapper

    for name in names:
        module_name, _, function = name.rpartition(".")
        module = importlib.import_module(f"firmware_py.{module_name}")
        original = getattr(module, function)
        originals.append((module, function, original))
        setattr(module, function, wrap(name, original))
    try:
        yield calls
    finally:
        for module, function, original in originals:
            setattr(module, function, original)


def any_force_map() -> bytes:
    """A force map for proofs: random coefficients as large as a fitted one's."""
    random = np.random.default_rng(5)
    blob = bytearray(forcemap.BLOB_BYTES)
    blob[0], blob[1], blob[2] = 0x46, forcemap.VERSION, 12
    struct.pack_into("<ii", blob, 4, 78_000_000, 19_000_000)
    struct.pack_into(f"<{forcemap.COEFS}h", blob, 12, *random.integers(-300, 300, forcemap.COEFS).tolist())
    return bytes(blob)


def strokes(n: int, frames: int) -> Iterator[tuple[FrameStream, calib.Calibration]]:
    """n strokes over lumps and over none, through sensors from good to poor, with their calibrations."""
    fields = [StrokeField(*pair) for pair in read_strokes()]
    for seed in range(n):
        level = ("good", "typical", "poor")[seed // len(fields) % 3]
        model = SensorModel(fields[seed % len(fields)], LEVELS[level], seed, travel_mm=76.0)
        yield model.stroke(frames), model.calibration()

"""A recording of ours, by whatever array, as frames: from its decoded topics, which say their own size."""

from __future__ import annotations

from base64 import b64decode
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from mcap.records import Message

from palpate.importing.declaration import Declaration
from palpate.importing.frames import FARTHEST_MM, GivenFrames, ImportFailed
from palpate.recording import channels
from palpate.recording.reader import Recording

LEAST_PITCH_MM = 0.01


def read(path: Path, said: Declaration | None, whole: bool = False) -> tuple[GivenFrames, Declaration]:
    """Frames of a recording, and what they are; the pitch is the recording's own, or that of `said`.

    whole : bool
        All frames, for their places come from elsewhere; else those of strokes.

    Raises
    ------
    NoSuchFile, NotARecording
    ImportFailed
        It holds no tactile images, or does not say its pitch.
    """
    recording = Recording(path)
    images: list[np.ndarray] = []
    motions: list[list[float]] = []
    numbers: list[int] = []
    shape: tuple[int, int] = (0, 0)
    stroke, running = 0, False
    for topic, record in recording.records():
        if not isinstance(record, Message):
            continue
        told = channels.read_json(record.data)
        if topic == channels.STROKE and told.get("state") == "started":
            stroke, running = stroke + 1, True
        elif topic == channels.STROKE and told.get("state") == "ended":
            running = False
        elif topic == channels.IMAGE:
            own_shape, image = _image(told, path)
            if images and own_shape != shape:
                raise ImportFailed(f"{path} holds tactile images of several arrays")
            shape = own_shape
            images.append(image)
        elif topic == channels.MOTION and len(motions) < len(images):
            motions.append(_motion(told, path))
            numbers.append(stroke if running else -1)
    if len(motions) < 2 or len(images) != len(motions):
        raise ImportFailed(f"{path} holds no tactile images with places")
    pitch = said.pitch_mm if said is not None else _pitch(recording, path)
    own = Declaration(*shape, pitch) if said is None else replace(said, rows=shape[0], columns=shape[1])
    motion, kept = np.array(motions), np.array(numbers) >= 0
    if whole:
        kept[:], numbers, own = True, [0] * len(numbers), replace(own, lift=False)
    if not kept.any():
        raise ImportFailed(f"{path} holds no stroke")
    frames = GivenFrames(
        np.array(images)[kept],
        motion[kept, 0],
        motion[kept, 1],
        motion[kept, 2] / 1e6,
        np.array(numbers)[kept],
        (),
    )
    return frames, own if whole else replace(own, stroke="stroke")


def began_s(path: Path) -> float:
    """Unix time of a recording's first image."""
    found = Recording(path).records()
    times = (r.log_time for topic, r in found if topic == channels.IMAGE and isinstance(r, Message))
    return next((ns / 1e9 for ns in times), 0.0)


def _image(told: dict[str, object], path: Path) -> tuple[tuple[int, int], np.ndarray]:
    match told:
        case {"height": int(rows), "width": int(columns), "data": str(data)}:
            with suppress(ValueError):
                cells = np.frombuffer(b64decode(data), "<u2")
                if cells.size == rows * columns > 0 < rows:
                    return (rows, columns), cells.reshape(rows, columns) / 1e3
    raise ImportFailed(f"{path} holds a tactile image that cannot be read")


def _motion(told: dict[str, object], path: Path) -> list[float]:
    """Position, displacement (mm) and time (us)."""
    found = []
    for name, most in (("position_mm", FARTHEST_MM), ("displacement_mm", FARTHEST_MM), ("time_us", 1e18)):
        match told.get(name):
            case int() | float() as number if abs(number) <= most:
                found.append(float(number))
            case _:
                raise ImportFailed(f"{path} holds a motion whose {name} is none of a stroke")
    return found


def _pitch(recording: Recording, path: Path) -> tuple[float, float]:
    try:
        pitch = float(recording.metadata().get("probe", {})["pitch_mm"])
        if not LEAST_PITCH_MM <= pitch <= FARTHEST_MM:
            raise ValueError
    except (KeyError, ValueError):
        raise ImportFailed(f"{path} does not say its array's pitch; give a declaration with --as") from None
    return pitch, pitch

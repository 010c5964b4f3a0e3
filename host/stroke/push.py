"""A stroke's frames, as they came over the link, through the firmware's own pipeline."""

from __future__ import annotations

from collections.abc import Iterable

from firmware_py.pipeline import Pipeline
from palpate.wire.events import Frame


def push(
    pipeline: Pipeline,
    frames: Iterable[Frame],
    force_map: object | None,
    press: Iterable[Frame] | None = None,
) -> int:
    """Push the press and then the stroke's frames through; the pipeline's status (`firmware_py.status`).

    press: the frames between contact and the stroke's start, if there are any.
    """
    pipeline.begin_press()
    for frame in press or ():
        pipeline.add_press(frame.packed, frame.displacement_um)
    pipeline.reset()
    for frame in frames:
        pipeline.add_frame(frame.packed, frame.position_um, frame.displacement_um)
    return int(pipeline.finish(force_map))

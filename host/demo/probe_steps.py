"""The demo's second half: a probe, the model on it, strokes, their replay."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.console import progress
from palpate.demo.lump import LUMP, NOISE, SEED, STROKES, say
from palpate.errors import PalpateError
from palpate.wire.events import Estimate, Frame, TactileMap

if TYPE_CHECKING:
    from palpate.answer.told import AcrossStroke
    from palpate.answer.visit import VisitAnswer


def emulate_step(runtime: str, out: Path) -> Any:
    """Start an emulated probe over the demo's lump."""
    from palpate.sim.probe.emulated import EmulatedProbe
    from palpate.sim.probe.over_lump import strokes_over

    strokes, calibration = strokes_over(LUMP, NOISE, SEED, 50, STROKES, press=True)
    store = out / "probe"
    shutil.rmtree(store, ignore_errors=True)  # a probe fresh from the factory
    public_key = (out / "key" / "public.key").read_bytes()
    return EmulatedProbe(
        runtime, strokes, store=store, public_key=public_key, calibration=calibration, roomy=True
    )


def flash_step(port: str, image: bytes) -> str:
    """Flash the image; the model's id as the probe then tells it."""
    from palpate.link.flash import flash
    from palpate.link.probe import Probe

    with Probe.open(port) as probe, progress("bytes") as bar:
        task = bar.add_task("   flashing", total=len(image))
        done = flash(probe, image, lambda at, size: bar.update(task, completed=at, total=size))
        model_id = probe.refresh_identity().model_id
    if model_id != done.model_id:
        raise PalpateError(f"the probe reports model {model_id} and not {done.model_id}, which was flashed")
    say(f"{done.size} bytes; signature verified, self-test passed; the probe reports model {model_id}")
    return model_id


def stroke_step(port: str, recording: Path) -> tuple[list[Frame], TactileMap, Estimate]:
    """Stroke and record; of the first stroke frames, tactile map and estimate."""
    from palpate.link.session import both_counts, counts_line, recorded

    frames: list[Frame] = []
    found: TactileMap | None = None
    estimate: Estimate | None = None
    with recorded(port, recording, overwrite=True) as probe:
        for event in probe.stream(strokes=STROKES, timeout_s=60):
            if isinstance(event, Frame) and estimate is None:
                frames.append(event)
            elif isinstance(event, TactileMap):
                found = found or event
            elif isinstance(event, Estimate):
                estimate = estimate or event
        say(counts_line(both_counts(probe)))
    if estimate is None or found is None:
        raise PalpateError("the strokes ended without an estimate; run the demo again with PALPATE_DEBUG=1")
    return frames, found, estimate


def replay_step(recording: Path) -> tuple[bool, AcrossStroke | None, VisitAnswer | None]:
    """Replay the recording.

    Returns
    -------
    Whether every estimate is the same, bit for bit; what the host tells across the first stroke; what the
    strokes say together.
    """
    from palpate.answer.visit import visit_answer
    from palpate.stroke.replay import replay

    strokes = list(replay(recording))
    told = strokes[0].told if strokes else None
    identical = bool(strokes) and all(stroke.identical for stroke in strokes)
    together = visit_answer([(stroke.probe, stroke.told) for stroke in strokes])
    return identical, None if told is None else told.across, together

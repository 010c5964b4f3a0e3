"""Two recordings of one lump compared by the forward model: fitted together, or by answers that are kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.answer.fitted import Change, Inverted, Value
from palpate.errors import RecordingError
from palpate.inversion.felt import NotInvertible
from palpate.inversion.kept import Felt, kept_answers
from palpate.inversion.recorded import felt_strokes
from palpate.inversion.visits import invert_visits
from palpate.recording.playback import open_recording
from palpate.sim.probe.noise import Noise

CHANGES = {"d_mm": "diameter", "depth_mm": "depth"}
ASSUMES = (
    "90 % intervals. Both visits are fitted as strokes over one lump in one tissue: stiffness, tissue and, "
    "of one probe, gains are taken to be the same."
)


def refined_change(first: Path, second: Path, noise: Noise) -> Change:
    """Fit the strokes of two recordings together; the change is an unknown of its own.

    Raises
    ------
    PalpateError
        A recording cannot be read, or none of its strokes can be inverted.
    """
    serials = []
    for path in (first, second):
        with open_recording(path) as session:
            serials.append(session.identity.serial)
    return invert_visits(_strokes(first), _strokes(second), noise, same_probe=serials[0] == serials[1])


def _strokes(path: Path) -> list[Felt]:
    found, why = [], "it holds presses only"
    for stroke, start in felt_strokes(path):
        if isinstance(stroke, NotInvertible):
            why = str(stroke)
        elif not stroke.alone:
            found.append((stroke, start))
    if not found:
        raise RecordingError(f"no stroke of {path} can be refined: {why}")
    return found


def kept_change(first: Path, second: Path) -> dict[str, Value]:
    """The change of each quantity by answers that are kept of both recordings; {} where one has none.

    Each visit's value is the mean of its strokes', and no surer than one of them: what they get wrong is
    mostly the same.
    """
    visits = [[one for one in kept_answers(path) if one.fits and one.lump] for path in (first, second)]
    if not all(visits):
        return {}
    out = {}
    for name in CHANGES:
        (before, a), (after, b) = (_pooled(answers, name) for answers in visits)
        half = float(np.hypot(a, b))
        out[name] = Value(*(float(np.exp(after - before + sign * half)) for sign in (0, -1, 1)))
    return out


def _pooled(answers: list[Inverted], name: str) -> tuple[float, float]:
    """Mean logarithm, and the half-width of one stroke's interval."""
    values = [one.values[name] for one in answers]
    halves = [np.log(one.high / one.low) / 2 for one in values if one.low and one.high]
    return float(np.mean(np.log([one.value for one in values]))), float(np.median(halves))


def change_text(name: str, ratio: Value) -> str:
    """A change in a sentence, in per cent."""
    low, high = ratio.low or 0.0, ratio.high or np.inf
    span = f"({_percent(low)} to {_percent(high)})"
    if low <= 1.0 <= high:
        return f"The {CHANGES[name]} differs by {_percent(ratio.value)} {span}: no change is told."
    way = "grew" if ratio.value > 1 else "shrank"
    return f"The {CHANGES[name]} {way} by {abs(100 * (ratio.value - 1)):.1f} % {span}."


def _percent(ratio: float) -> str:
    return f"{100 * (ratio - 1):+.1f} %".replace("-", "\u2212")

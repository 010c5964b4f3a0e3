"""What the demo strokes, and how it speaks."""

from __future__ import annotations

from palpate.console import note

LUMP = "d12h06e20f07_ball"
"""The lump under the emulated probe: a ball that no model has met."""

NOISE, SEED, STROKES = "typical", 10, 3


def say(text: str) -> None:
    """A line under the step's heading."""
    note(f"   {text}")

"""What the demo strokes, and how it speaks."""

from __future__ import annotations

from palpate.cli.output import note

LUMP = "d12h07e20f09"
"""The lump under the emulated probe: not one of the thesis' thirty."""

NOISE, SEED = "typical", 5


def say(text: str) -> None:
    """A line under the step's heading."""
    note(f"   {text}")

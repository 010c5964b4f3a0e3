"""What the host adds to a probe's answer: a lump's width and place across the stroke, its layer, and why a
model is not for a stroke."""

from typing import Any

NOTHING_TOLD: dict[str, Any] = {"across": None, "layer": None, "outside": []}
"""As `--json` prints it beside an answer to which the host has nothing to add (`told.Told`)."""

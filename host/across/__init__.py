"""What the host adds to a probe's answer: a lump's width and place across the stroke, its layer, and why a
model is not for a stroke."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from palpate.across.told import Told
    from palpate.link.events import Estimate

NOTHING_TOLD: dict[str, Any] = {"across": None, "layer": None, "outside": []}
"""As `--json` prints it beside an answer to which the host has nothing to add (`told.Told`)."""


def answer_dict(said: Estimate, told: Told | None) -> dict[str, Any]:
    """An answer for programs, and what the host adds: `--json` and LabStreamingLayer have the same."""
    return said.as_dict() | (NOTHING_TOLD if told is None else told.as_dict())

"""What the host adds to a probe's answer: a lump's width and place across the stroke, its layer, and why a
model is not for a stroke."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from firmware_py import outputs

if TYPE_CHECKING:
    from palpate.answer.told import Told
    from palpate.wire.events import Estimate

NOTHING_TOLD: dict[str, Any] = {"across": None, "layer": None, "outside": []}
"""As `--json` prints it beside an answer to which the host has nothing to add (`told.Told`)."""


def answer_dict(said: Estimate, told: Told | None) -> dict[str, Any]:
    """An answer for programs, and what the host adds: `--json` and LabStreamingLayer have the same."""
    return probe_dict(said, told) | (NOTHING_TOLD if told is None else told.as_dict())


def probe_dict(said: Estimate, told: Told | None) -> dict[str, Any]:
    """The answer alone; its depth, which no probe sends, is the surest that is known."""
    out = said.as_dict()
    if "depth_mm" in out:
        layer = None if told is None else told.layer
        out["depth_from"] = "tie" if layer is None else "layer"
        if layer is not None:
            out["depth_mm"] = dict(zip(outputs.PARTS, layer.depth_mm))
    return out

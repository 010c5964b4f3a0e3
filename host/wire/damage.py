"""What a probe has found damaged in its store, in words."""

from __future__ import annotations

from firmware_py import messages

DAMAGES = {
    messages.DAMAGED_CALIBRATION: "calibration",
    messages.DAMAGED_MODEL: "model record",
    messages.DAMAGED_SETTINGS: "settings",
    messages.DAMAGE_REPAIRED: "one copy, repaired from the other",
    messages.DAMAGE_TRIAL_HUNG: "a model that the probe hung in while it tried it",
}


def damage_words(damage: int) -> list[str]:
    """What the probe has found damaged in its store, in words."""
    return [word for bit, word in DAMAGES.items() if damage & bit]

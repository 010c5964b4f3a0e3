"""What an equilibrium must be before it passes for a result, in the plane and in space alike."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.sim.tissue.state import State

_MOST_FORCE_ERROR = 1e-6


def inside_out(state: State) -> str:
    """Why a state of balance is refused: tissue does not get into it."""
    return f"an element is turned inside out (det F = {state.smallest_jacobian:.2g})"


def fault(row: dict[str, Any], state: State, deepest_mm: float, layer: str) -> str | None:
    """What is wrong with one position's results, in words; None if nothing is.

    Parameters
    ----------
    row : dict
        What the probe feels, with `displacement_mm` and `force_error` (of the force on the probe).
    state : State
        The equilibrium that it was read from.
    deepest_mm : float
        The displacement at which the probe would have gone through.
    layer : str
        What it would have gone through.
    """
    if not all(np.isfinite(value).all() for value in row.values()):
        return "the result is not a number"
    if state.smallest_jacobian <= 0.0:
        return inside_out(state)
    if abs(row["force_error"]) > _MOST_FORCE_ERROR:
        return f"the contact forces miss the force on the probe by {row['force_error']:.1e} of it"
    if row["displacement_mm"] >= deepest_mm:
        return f"the probe has gone through the {layer}"
    return None

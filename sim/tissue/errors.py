"""What can go wrong, as a tree.

TissueError
  CaseError    (UsageError)    invalid arguments: a case or a setting that does not make sense
    FoldedElement              no mesh: the lump's shape and place fold an element over
  SweepStopped (RuntimeError)  what computes a sweep has gone; what was finished is kept
  StrokeError  (RuntimeError)  the work failed: no equilibrium at one position, with its reason
"""

from __future__ import annotations

from palpate.errors import PalpateError, UsageError


class TissueError(PalpateError):
    """Any error of `palpate.sim.tissue`."""


class CaseError(TissueError, UsageError):
    """A case, its code or a setting is not one that can be simulated; the text is one sentence."""


class FoldedElement(CaseError):
    """The lump's shape and place fold an element of the mesh over."""


class SweepStopped(TissueError, RuntimeError):
    """The workers of a sweep, or its cluster, have gone."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"what computes the sweep has gone ({reason}); finished strokes are kept: run it again to go on"
        )


class StrokeError(TissueError, RuntimeError):
    """The stroke could not be computed.

    Parameters
    ----------
    code : str
        The case's code.
    position_mm : float
        The probe's position at which it failed.
    reason : str
        Why, in words.
    """

    def __init__(self, code: str, position_mm: float, reason: str) -> None:
        self.code = code
        self.position_mm = float(position_mm)
        self.reason = reason
        super().__init__(f"{code} failed at {position_mm:+.1f} mm: {reason}")

    def __reduce__(self) -> tuple[type[StrokeError], tuple[str, float, str]]:
        return type(self), (self.code, self.position_mm, self.reason)

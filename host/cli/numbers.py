"""Numbers on the command line: finite ones."""

from __future__ import annotations

import math
from typing import Any

import click

SEED = click.IntRange(0, (1 << 64) - 1)
"""Of any draw of random numbers."""


class Finite(click.FloatRange):
    """A number between two limits that is neither NaN, which lies between any two, nor infinite."""

    def _describe_range(self) -> str:
        """For the help; without limits click would say `x<=None`."""
        return "any number" if self.min is None and self.max is None else super()._describe_range()

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number; click's sentence where it is none."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number", param, ctx)
        return number

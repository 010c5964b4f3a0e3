"""The words of a model: kinds, outputs, links, terms."""

from __future__ import annotations

from firmware_py import outputs

KINDS = ("thesis", "field")
# Name and unit of the outputs in the order of the wire; an image holds millionths of these units.
OUTPUTS = tuple((name, unit) for name, unit, _ in outputs.TABLE)
SYMBOLS = tuple(name.removesuffix("_" + unit.replace("/", "_per_")) for name, unit in OUTPUTS)
"""The outputs as equations name them: F, t, d, h, E_inv23."""
LINKS = ("ln", "identity")

Term = tuple[int, ...]

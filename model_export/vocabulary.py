"""The words of a model: kinds, outputs, links, terms."""

from __future__ import annotations

from firmware_py import outputs

KINDS = ("thesis", "field")
# Name and unit of the outputs in the order of the wire; an image holds millionths of these units.
OUTPUTS = tuple((name, unit) for name, unit, _ in outputs.TABLE)
LINKS = ("ln", "identity")

Term = tuple[int, ...]

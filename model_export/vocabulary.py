"""The words of a model: kinds, outputs, links, terms."""

from __future__ import annotations

KINDS = ("thesis", "field")
# Name and unit of the five outputs in the order of the wire; an image holds millionths of these units.
OUTPUTS = (("F_N_per_m", "N/m"), ("t_mm", "mm"), ("d_mm", "mm"), ("h", "1"), ("E_inv23", "1"))
LINKS = ("ln", "identity")

Term = tuple[int, ...]

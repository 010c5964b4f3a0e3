"""A simulated model corrected by real strokes: few data help and do not hurt (docs/data-sets.md)."""

"""Data sets: recorded strokes over lumps that are known, in a table (docs/data-sets.md)."""

"""How far a model can be believed on strokes over lumps that are known (docs/data-sets.md)."""

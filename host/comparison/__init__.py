"""Two visits to one lump: what has changed, beyond what strokes and visits differ by themselves."""

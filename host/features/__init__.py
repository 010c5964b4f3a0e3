"""Features of a stroke in float64: of its tactile map, and of the press before it."""

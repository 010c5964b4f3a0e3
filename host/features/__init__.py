"""Features of a stroke in float64: what the probe's integers are checked against."""

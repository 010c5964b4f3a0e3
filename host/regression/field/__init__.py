"""The field kind: log-polynomials learned from space-filling lumps, seen through the probe's sensors."""

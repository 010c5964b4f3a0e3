"""The field kind: log-polynomials learned from space-filling lumps, observed through the probe's sensors."""

"""A sensor measured from recordings: its noise, as training and emulation take it (docs/data-sets.md)."""

"""The thesis kind: its equations and Table 1, from its thirty runs."""

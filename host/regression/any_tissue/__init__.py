"""Lumps in tissue that nobody told the probe about: a model in two stages, and how good it is."""

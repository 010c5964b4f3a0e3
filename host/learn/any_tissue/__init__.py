"""Lumps in tissue that the probe knows nothing about: a model in two stages, and how good it is."""

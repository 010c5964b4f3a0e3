"""Frames from anybody's sensor as recordings that everything else reads (docs/data-sets.md)."""

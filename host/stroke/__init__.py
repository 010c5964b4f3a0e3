"""A stroke, put together from events: its frames, its press, its map, its estimate."""

"""A model of solid lumps: balls and ellipsoids on the line or beside it, in tissue that nobody knows."""

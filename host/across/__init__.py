"""What the host adds to a probe's answer: a lump's width across the stroke, and its place there."""

NOTHING_TOLD = {"across": None, "layer": None}
"""As `--json` prints it beside an answer to which the host has nothing to add (`told.Told`)."""

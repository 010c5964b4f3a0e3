"""What the host adds to a probe's answer: a lump's width across the stroke, and its place there."""

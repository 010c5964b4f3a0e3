"""What a reader of a figure sees first when it is wrong: words on words, and words cut off."""

from __future__ import annotations

import io
import itertools
from unittest.mock import patch

from matplotlib.figure import Figure
from matplotlib.text import Text

SLACK_PX = 1.0
"""Boxes of text hold some air above and below the letters."""


def collisions(figure: Figure) -> list[tuple[str, str]]:
    """Texts of a figure that overlap as they are drawn, in pairs; with "the edge" those that it cuts."""
    seen = []
    draw = Text.draw

    def watched(text, renderer, *args, **kwargs):
        if text.get_visible() and text.get_text().strip():
            box = text.get_window_extent(renderer)
            seen.append((text.get_text(), box.x0, box.x1, box.y0, box.y1))
        return draw(text, renderer, *args, **kwargs)

    with patch.object(Text, "draw", watched):
        figure.savefig(io.BytesIO(), format="png", dpi=100)
    seen = list(dict.fromkeys(seen))
    found = [
        (a[0], b[0])
        for a, b in itertools.combinations(seen, 2)
        if min(a[2], b[2]) - max(a[1], b[1]) > SLACK_PX and min(a[4], b[4]) - max(a[3], b[3]) > SLACK_PX
    ]
    wide, high = 100 * figure.get_size_inches()
    cut = [t[0] for t in seen if t[1] < -1 or t[2] > wide + 1 or t[3] < -1 or t[4] > high + 1]
    return found + [(words, "the edge") for words in cut]

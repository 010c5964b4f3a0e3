"""Figures can be read: no words lie on others, and none are cut off."""

import importlib.util

from palpate.report import style
from tests.docs.blocks import DOCS
from tests.host.report.collisions import collisions


def test_the_figure_of_accuracy_can_be_read():
    spec = importlib.util.spec_from_file_location("draw_accuracy", DOCS / "draw_accuracy.py")
    draw = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(draw)
    with style.look():
        assert collisions(draw.figure()) == []


def test_words_on_words_are_noticed():
    with style.look():
        figure = style.new(2.0, 1.5)
        axes = figure.subplots()
        axes.set_xticks([0.0, 0.01, 1.0], ["a long label", "another one", "far"])
        axes.text(0.5, 0.5, "beyond the paper" * 4, in_layout=False)
    found = {words for pair in collisions(figure) for words in pair}
    assert {"a long label", "another one", "the edge"} <= found

"""Figures can be read: no words lie on others, and none are cut off."""

import importlib.util

import numpy as np
import pandas as pd
import pytest

from palpate.report import style
from tests.docs.blocks import DOCS
from tests.host.report.collisions import collisions
from tests.studies import computed, settings, tissues
from tests.studies.figure import study_figure

STUDIES = {**settings.STUDIES, **tissues.STUDIES, **computed.STUDIES}
LABELS = [
    "as trained",
    *(f"two lumps {apart:g} mm apart" for apart in tissues.TWO_APART_MM),
    *tissues.TISSUES,
]


@pytest.mark.parametrize(
    "name", ["position", "tissue", max(STUDIES, key=lambda one: len(STUDIES[one].title))]
)
def test_a_study_can_be_read(name):
    """Tick labels of *position* and the two titles of *tissue* lay on each other."""
    n = len(LABELS)
    draw = np.random.default_rng(1)
    result = pd.DataFrame({f"{x}_error": draw.uniform(0.005, 0.06, n) for x in "tdh"})
    result = result.assign(
        setting=LABELS,
        d_half=draw.uniform(0.05, 0.3, n),
        E_inv23_r2=draw.uniform(0.4, 0.9999, n),
        hard_soft=draw.uniform(0.7, 1.0, n),
    )
    assert collisions(study_figure(STUDIES[name], result)) == []


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

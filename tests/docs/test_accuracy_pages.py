"""The pages on accuracy: their tables have a writer, and their figures are drawn from them."""

import importlib.util
import re

import numpy as np
import pytest

from palpate.report import style
from tests.docs.blocks import ROOT

PAGES = [ROOT / "docs" / f"accuracy{part}.md" for part in ("", "-told", "-thesis")]
BY_ANOTHER_COMMAND = {"depth"}


def script(name):
    """A program of docs/ as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_table_that_is_written_has_its_place_on_one_page():
    text = "".join(page.read_text("utf-8") for page in PAGES)
    begun, ended = (re.findall(f"<!-- {word} ([a-z0-9-]+) -->", text) for word in ("begin", "end"))
    assert begun == ended and len(set(begun)) == len(begun)
    written = set(script("fill_accuracy").Numbers("", "").blocks())
    assert written <= set(begun) <= written | BY_ANOTHER_COMMAND


def test_tissue_place_and_noise_are_told_in_this_order():
    page = PAGES[0].read_text("utf-8")
    heads = re.findall("(?m)^## (.*)$", page)
    assert heads[:3] == ["Tissue that the probe knows nothing about", "Lumps anywhere", "Noise"]
    for name in ("tissue", "place", "noise"):
        assert f"(figures/accuracy-{name}.svg)" in page


def test_figures_are_drawn_from_the_tables_of_the_page():
    draw = script("draw_accuracy")
    found = draw.tables(PAGES[0].read_text("utf-8"))
    with style.look():
        levels, pairs = draw.noise(found).axes
        by_place, bound, said = draw.place(found).axes
        tissue = draw.tissue(found).axes
    first = draw.percent(
        draw.table_with(found, "typical, with its press", "E_fat")["typical, with its press"]["d"]
    )
    assert levels.patches[0].get_height() == first
    assert len(pairs.patches) == 18 and len(by_place.patches) == 9 and len(bound.patches) == 8
    assert sum(bar.get_width() for bar in said.patches) == pytest.approx(300, abs=2)
    width = [line.get_ydata() for line in tissue[0].lines]
    assert np.all(np.diff(width, axis=1) > 0) and np.all(np.diff(width, axis=0) < 0), "soft fat, wide image"
    with pytest.raises(SystemExit, match="no table"):
        draw.table_with(found, "no such row", "d")

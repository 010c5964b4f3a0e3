"""The page on building the probe shows what its command draws and prints."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "howto" / "build-the-probe.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def drawing():
    spec = importlib.util.spec_from_file_location("draw_probe", DOCS / "draw_probe.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_schematic_is_the_one_that_the_command_draws(drawing, tmp_path):
    drawing.schematic(tmp_path / "schematic.svg")
    assert (tmp_path / "schematic.svg").read_bytes() == (DOCS / "figures" / "schematic.svg").read_bytes()


@pytest.mark.parametrize("name", ["crosstalk", "face"])
def test_the_tables_are_those_that_the_command_prints(name, drawing):
    rows = ["| " + " | ".join(row) + " |" for row in getattr(drawing, name)()]
    assert "\n".join(rows) in PAGE


def test_every_pin_of_the_schematic_is_in_the_table(drawing):
    drawn = (DOCS / "figures" / "schematic.svg").read_text(encoding="utf-8")
    pins = {int(n) for n in re.findall(r"GP(\d+)", drawn)}
    table = "\n".join(line for line in PAGE.splitlines() if line.startswith("| GP"))
    assert pins and pins <= {int(n) for n in re.findall(r"GP(\d+)", table)}

"""Every line of the page's table of what the emulated board does names the test that holds it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "tests" / "sim" / "probe"
PAGE = (ROOT / "docs" / "evidence" / "board.md").read_text(encoding="utf-8")
TABLE = PAGE[PAGE.index("| what | measured | held by |") :].split("\n\n")[0].splitlines()[2:]


@pytest.mark.parametrize("line", TABLE, ids=lambda line: line.split("|")[1].strip()[:30])
def test_the_test_that_a_line_names_is_there(line):
    """`test_file.py -k words`, as pytest takes it."""
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert len(cells) == 3
    named = re.findall(r"`(test_\w+\.py)(?: -k (\w+))?`", cells[-1])
    assert named
    for file, words in named:
        tests = re.findall(r"^def (test_\w+)\(", (FOLDER / file).read_text(encoding="utf-8"), re.MULTILINE)
        assert [name for name in tests if words in name], (file, words)

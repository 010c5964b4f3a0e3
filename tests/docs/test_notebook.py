"""The students' notebook runs from top to bottom, and what it prints is true."""

from __future__ import annotations

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parents[2] / "docs" / "examples" / "first_hour.ipynb"


@pytest.mark.timeout(600)
def test_the_notebook_runs_and_its_model_finds_the_lump(tmp_path):
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "it is kept without outputs"
    NotebookClient(notebook, timeout=850, resources={"metadata": {"path": tmp_path}}).execute()
    printed = "".join(o.get("text", "") for cell in notebook.cells for o in cell.get("outputs", []))
    found = re.search(r"diameter: ([\d.]+) mm", printed)
    assert found and float(found[1]) == pytest.approx(12.0, abs=1.2)
    hits = re.search(r"in (\d+)% of the intervals", printed)
    assert hits and int(hits[1]) >= 60

"""What the documentation says of the bundled models is what their recipes say, and of these very models."""

import importlib.util
import json
import re
import sys
import tomllib
from pathlib import Path

import pytest

from palpate.models import NAMES, file_hash, path
from palpate.report import style
from tests.docs.blocks import DOCS, ROOT

HASH = re.compile(r"\b[0-9a-f]{64}\b")


def script(name):
    """A program of docs/ as a module."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def fill():
    return script("fill_accuracy")


def test_every_page_is_as_the_command_writes_it(fill):
    for page, text in fill.pages().items():
        assert page.read_text("utf-8") == text, f"{page.relative_to(ROOT)}: run python docs/fill_accuracy.py"


def test_the_page_of_reliability_says_what_campaigns_have_left():
    fill = script("fill_reliability")
    assert fill.PAGE.read_text("utf-8") == fill.page(), "run python docs/fill_reliability.py"
    for test in (row[2] for rows in fill.TABLES.values() for row in rows):
        file, _, name = test.partition("::")
        assert f"def {name.partition('[')[0]}(" in (ROOT / file).read_text("utf-8"), test


def test_of_every_fault_that_no_test_noticed_there_is_a_reason():
    fill = script("fill_reliability")
    known = tomllib.loads(fill.SURVIVORS.read_text("utf-8"))["survivor"]
    reasons = {(one["module"], one["was"], one["now"]): {*one} - {"module", "was", "now"} for one in known}
    assert all(kind in ({"equivalent"}, {"missing"}) for kind in reasons.values())
    for module, one in json.loads(fill.MUTANTS.read_text("utf-8")).items():
        for was, now in one["survivors"]:
            assert (module, was, now) in reasons


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("folder", ["evidence", "reference/models"])
def test_a_page_is_of_the_model_that_is_bundled(folder, name):
    """Its stamp holds the hash of the file that lies in the package, not of one before."""
    text = (DOCS / folder / f"{name}.md").read_text("utf-8")
    (stamp,) = re.findall(r"(?m)^\*Model .*$", text)
    assert HASH.findall(stamp) == [file_hash(path(name))], "stale: run python docs/fill_accuracy.py"


def test_the_figure_is_of_the_models_that_are_bundled():
    drawn = (DOCS / "figures" / "accuracy.svg").read_text("utf-8")
    assert sorted(set(HASH.findall(drawn))) == sorted(file_hash(path(name)) for name in NAMES)


def test_the_table_has_a_row_for_each_model_and_is_in_both_places(fill):
    shown = fill.models_table()
    assert [name for name in NAMES if f"(`{name}`)" not in shown] == []
    assert len(shown.splitlines()) == len(NAMES) + 2
    for page in (ROOT / "README.md", DOCS / "accuracy.md"):
        assert shown in page.read_text("utf-8")


def test_another_models_scores_change_the_table(fill, monkeypatch):
    """A table that did not follow the recipes would pass the tests above."""
    before = fill.models_table()
    real = fill.recipe

    def worse(name):
        found = real(name)
        fill.main_row(found["scores"])["d_error"] += 0.1
        return found

    monkeypatch.setattr(fill, "recipe", worse)
    after = fill.models_table()
    assert sum(a != b for a, b in zip(before.splitlines(), after.splitlines())) == len(NAMES)


def test_the_figure_shows_the_scores():
    draw = script("draw_accuracy")
    with style.look():
        axes = draw.figure().axes
    errors = draw.recipe(draw.TOLD[0])["scores"]["held_out"]
    wanted = next(row for row in errors if row["setting"] == "typical, with its press")["d_error"]
    assert axes[0].patches[0].get_height() == pytest.approx(100 * wanted)
    assert all(axis.images for axis in axes[3:6])


def test_the_program_refuses_other_words():
    import subprocess

    done = subprocess.run(
        [sys.executable, DOCS / "fill_accuracy.py", "balls"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=300,
    )
    assert done.returncode == 1 and "usage" in done.stderr


def test_pages_of_evidence_name_their_command():
    for page in sorted(Path(DOCS / "evidence").glob("*.md")):
        assert "`python " in page.read_text("utf-8"), page.name

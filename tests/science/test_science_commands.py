"""`palpate fit` and `palpate study`: the whole on few strokes, and wrong words refused before any work."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from host.cli import fit, study
from host.errors import PalpateError, UsageError
from model_export.schema import ModelSpec

STROKES = Path(__file__).parent / "data"


def test_one_command_goes_from_strokes_to_a_model_and_its_held_out_table(tmp_path):
    """On few lumps; nothing is simulated, since all parts are there."""
    out = tmp_path / "m.json"
    words = [
        str(STROKES),
        "--kind",
        "field",
        "--out",
        str(out),
        "--noise",
        "good",
        "--workers",
        "1",
        "--json",
    ]
    result = CliRunner().invoke(fit.command, words)
    assert result.exception is None, result.output
    said = json.loads(result.stdout)
    assert {row["noise"] for row in said["held_out"]} == {"none", "good", "typical", "poor"}
    assert {row["strokes"] for row in said["held_out"] if row["model"] == "field"} == {1, 4}
    assert 0 <= said["flagged_inside"] < said["flagged_or_not_found_outside"] <= 1
    assert said["outside_strokes"] > 0 and said["training"]["rim_lumps"] > 0
    distances = said["flagged_by_distance"]
    assert distances[0]["from"] is None and distances[-1]["to"] is None
    assert all(0 <= row["flagged"] <= 1 and row["strokes"] > 0 for row in distances)
    assert said["excluded"] and said["detectability"] and said["coverage"]
    assert ModelSpec.load(out).training["noise"] == "good"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--noise", "awful"], "no noise level 'awful'; there are none, good, typical, poor"),
        (["--kind", "field", "--tissue", "d_mm=4"], "there is no 'd_mm'; there are"),
        (["--kind", "field", "--tissue", "gland_ratio=soft"], "'soft' is not a number"),
    ],
)
def test_wrong_words_to_fit_are_refused(tmp_path, words, sentence):
    result = CliRunner().invoke(fit.command, [str(tmp_path), "--out", str(tmp_path / "m.json"), *words])
    assert isinstance(result.exception, UsageError) and sentence in str(result.exception)
    assert list(tmp_path.iterdir()) == []


def test_a_study_that_does_not_exist_and_a_directory_without_strokes_are_refused(tmp_path):
    result = CliRunner().invoke(study.command, ["colour", str(tmp_path)])
    assert isinstance(result.exception, UsageError) and "no study 'colour'" in str(result.exception)
    result = CliRunner().invoke(study.command, ["noise", str(tmp_path)])
    assert isinstance(result.exception, PalpateError) and "no strokes in pairs" in str(result.exception)

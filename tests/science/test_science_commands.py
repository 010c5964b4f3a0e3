"""`palpate fit` and `palpate study`: wrong words are refused in one sentence before anything is computed."""

import pytest
from click.testing import CliRunner

from host.cli import fit, study
from host.errors import PalpateError, UsageError


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

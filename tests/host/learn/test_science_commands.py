"""`palpate fit`: the whole on few strokes; invalid arguments refused before any work."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import palpate
from palpate.cli import fit
from palpate.errors import PalpateError, UsageError
from palpate.model_export.schema import ModelSpec
from palpate.report import measured
from tests.docs.test_reference import fields_in_the_page
from tests.host.learn.conftest import STROKES


def test_one_command_goes_from_strokes_to_a_model_and_its_held_out_table(tmp_path):
    """On few lumps; nothing is simulated, since all parts are there."""
    out = tmp_path / "m.json"
    words = ["--kind", "field", "--tissue", "thesis", "--noise", "good", "--workers", "1", "--json"]
    result = CliRunner().invoke(fit.command, [str(STROKES), "--out", str(out), *words])
    assert result.exception is None, result.output
    said = json.loads(result.stdout)
    assert [row["setting"] for row in said["held_out"]] == ["good, one stroke", "real, one stroke"]
    assert 0 <= said["flagged_inside"] < said["flagged_or_not_found_outside"] <= 1
    assert said["outside_strokes"] > 0 and said["training"]["rim_lumps"] > 0
    assert said["excluded"] and said["detectability"] and said["coverage"]
    assert ModelSpec.load(out).training["noise"] == "good"
    assert set(said) == fields_in_the_page("fit-field")
    assert said["measured"] == {"map": None, "force_curves": []}


def test_what_was_measured_is_fitted_placed_and_printed(tmp_path):
    """Two lumps of the simulation's own kind, in other units: each is found where it was taken from."""
    x = np.linspace(-25, 25, 41)
    rows = zip(x, 4 + 1.5 * np.exp(-0.5 * ((x - 2) / 6) ** 2))
    (tmp_path / "map.csv").write_text("x,p\n" + "".join(f"{a:.3f},{b:.5f}\n" for a, b in rows))
    curves = measured.simulated_curves()
    weights = []
    for E in (1.0, 5.0):
        lines = "".join(f"{30 * float(curves[E](s)):.5f},{25 * s:.4f}\n" for s in (0.05, 0.1, 0.15, 0.2))
        weights.append(tmp_path / f"like-{E:g}.csv")
        weights[-1].write_text("force,mm\n" + lines)
    found = measured.measure(tmp_path / "map.csv", weights, thickness_mm=25.0)
    said = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert said["map"]["centre_mm"] == pytest.approx(2.0, abs=0.01)
    assert said["map"]["stdev_mm"] == pytest.approx(6.0, rel=0.01)
    assert abs(said["map"]["skewness"]) < 0.01 and said["map"]["rms_kPa"] < 0.01
    placed = {one["table"]: one for one in said["force_curves"]}
    assert placed["like-5"]["E_ratio"] == pytest.approx(5.0, rel=0.05)
    assert placed["like-5"]["misfit"] < 0.01 and placed["like-1"]["E_ratio"] < 1.1
    text = "".join(str(c) for table in found.tables() for column in table.columns for c in column.cells)
    assert "skewness" in text and "like-5" in text


def test_a_measured_file_that_is_not_there_is_said_before_the_work(tmp_path):
    words = ["--out", str(tmp_path / "m.json"), "--recording", str(tmp_path / "absent.csv")]
    result = CliRunner().invoke(fit.command, [str(STROKES), "--kind", "field", *words])
    assert isinstance(result.exception, PalpateError) and "absent.csv" in str(result.exception)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--noise", "awful"], "no noise level 'awful'; there are none, good, typical, poor"),
        (["--kind", "field", "--tissue", "d_mm=4"], "there is no 'd_mm' in a case's tissue; there are"),
        (["--kind", "field", "--tissue", "gland_ratio=soft"], "'soft' is not a number"),
    ],
)
def test_invalid_arguments_to_fit_are_refused(tmp_path, words, sentence):
    result = CliRunner().invoke(fit.command, [str(tmp_path), "--out", str(tmp_path / "m.json"), *words])
    assert isinstance(result.exception, UsageError) and sentence in str(result.exception)
    assert list(tmp_path.iterdir()) == []


def test_strokes_over_another_shape_are_refused_by_name(monkeypatch, tmp_path):
    """The shape is a word: the sentence was once written for numbers alone, and failed over it."""
    from palpate.learn import data
    from palpate.learn.scopes import TOLD
    from palpate.sim.tissue import Case

    monkeypatch.setattr(data, "_held", lambda _home: [Case(10.0, 0.8, 10.0, shape="ball")])
    monkeypatch.setattr(data, "_holds", lambda _home: True)
    with pytest.raises(PalpateError, match="holds strokes with shape ball, not cylinder"):
        data.check_tissue(tmp_path, TOLD)


@pytest.mark.parametrize("wrong", ["feild", "notes"])
def test_a_mistyped_directory_is_not_simulated_into(tmp_path, wrong):
    """A mistyped name began 4096 simulations, from the command line and from Python."""
    (tmp_path / "field" / "lumps").mkdir(parents=True)
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "monday.txt").write_text("no strokes here")
    before = list(tmp_path.rglob("*"))
    words = [str(tmp_path / wrong), "--kind", "field", "--out", str(tmp_path / "m.json")]
    result = CliRunner().invoke(fit.command, words)
    assert isinstance(result.exception, UsageError) and "--lumps N" in str(result.exception)
    with pytest.raises(UsageError, match="check the name"):
        palpate.fit(tmp_path / wrong, "field")
    assert list(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("there", [False, True])
def test_a_fit_begins_from_nothing_without_being_told_how_many_lumps(tmp_path, there):
    """The help's own example, `palpate fit out/field --kind field`, was refused in a new folder."""

    class Begun(Exception):
        pass

    def stop(what, done, total):
        raise Begun(what)

    if there:
        (tmp_path / "field").mkdir()
    with pytest.raises(Begun, match="simulating"):
        palpate.fit(tmp_path / "field", "field", workers=1, progress=stop)

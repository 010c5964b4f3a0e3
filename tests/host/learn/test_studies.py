"""Studies of the told model: every one runs, and says how good each setting is."""

import importlib
import json

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from palpate.errors import PalpateError, UsageError
from palpate.learn.observed import observe
from palpate.sim.tissue.any_tissue import PRESS_PARTS
from tests.host.learn.conftest import STROKES
from tests.studies import __main__, tissues
from tests.studies.settings import STUDIES


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_runs_and_says_how_good_its_first_setting_is(bench, name):
    row = next(STUDIES[name].run(bench))
    assert row["setting"] and 0 < row["d_error"] < 0.2 and row["n"] > 0


def test_strokes_over_another_tissue_are_simulated_once_and_scored(bench, fitted, tmp_path):
    changes = {"gland_ratio": 8.0}
    pairs = tissues.other_tissue(tmp_path, changes, lumps=4, workers=1)
    assert {pair.case.gland_ratio for pair in pairs} == {8.0}
    written = sorted(tmp_path.glob("*/strokes.parquet"))
    assert [path.parent.name for path in written] == ["tissue-gland_ratio-8", "tissue-gland_ratio-8-press"]
    assert all(len(pair.press) == len(PRESS_PARTS) for pair in pairs)
    before = [path.stat().st_mtime_ns for path in written]
    assert len(tissues.other_tissue(tmp_path, changes, lumps=4, workers=1)) == len(pairs)
    assert [path.stat().st_mtime_ns for path in written] == before
    observed = bench.felt(pairs, bench.noise, 1)
    row = tissues.tissue_row("gland 8 times the fat", fitted, observed)
    assert -0.5 < row["d_bias"] < 0.5 and 0 <= row["flagged"] <= 1 and 0 <= row["d_covered"] <= 1
    result = pd.DataFrame([row])
    shown = tissues.TISSUE.shown(result)
    assert "flagged" in shown.heads and len(shown.rows[0]) == len(shown.heads)


def test_fewer_bits_and_coarser_cells_change_what_the_pipeline_gets(bench):
    some = [bench.test[0].field]
    fine = observe(some, "typical", 3)
    coarse = observe(some, "typical", 3, alter=lambda counts: counts // 64 * 64 + 32)
    assert not np.array_equal(fine.X, coarse.X)
    assert coarse.features(["ln_base"]) == pytest.approx(fine.features(["ln_base"]), abs=0.05)


def test_a_study_is_printed_by_one_command():
    result = CliRunner().invoke(__main__.command, ["pitch", str(STROKES), "--json"])
    assert result.exception is None, result.output
    (said,) = json.loads(result.stdout)["tables"]
    assert [row["setting"] for row in said["rows"]] == ["1.5 mm (16 rows)", "3 mm (8 rows)"]
    noiseless = CliRunner().invoke(__main__.command, ["pitch", str(STROKES), "--noise", "none", "--json"])
    assert noiseless.exception is None, noiseless.output
    better = json.loads(noiseless.stdout)["tables"][0]["rows"][0]
    assert better["F_error"] < said["rows"][0]["F_error"], "the sensors are those that were asked for"


def test_a_study_that_does_not_exist_and_a_directory_without_strokes_are_refused(tmp_path):
    result = CliRunner().invoke(__main__.command, ["colour", str(tmp_path)])
    assert isinstance(result.exception, UsageError) and "no study 'colour'" in str(result.exception)
    result = CliRunner().invoke(__main__.command, ["noise", str(tmp_path)])
    assert isinstance(result.exception, PalpateError) and "no strokes over lumps" in str(result.exception)
    result = CliRunner().invoke(__main__.command, ["pitch", str(STROKES), "--noise", "loud"])
    assert isinstance(result.exception, PalpateError) and "loud" in str(result.exception)


@pytest.mark.parametrize("name", __main__.MODULES)
def test_every_name_has_its_module_and_says_so(name):
    module = importlib.import_module(f"tests.studies.{__main__.MODULES[name]}")
    assert name in module.STUDIES if name in __main__.RETRAINED else callable(module.tables)
    assert name in __main__.command.help

"""Studies of the field kind: every one runs, and says how good each setting is."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from palpate.regression.field import computed, data, tissues
from palpate.regression.field.study import STUDIES, study_table
from palpate.regression.observed import observe
from palpate.report.study_figures import save_study_figure
from palpate.sim.tissue.any_tissue import PRESS_PARTS

STROKES = Path(__file__).parent / "data"


SIGNATURE = 900


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
    observed = observe(data.stroke_fields(pairs), "typical", 1, force_map=bench.blob)
    row = tissues.tissue_row("gland 8 times the fat", fitted, observed)
    assert -0.5 < row["d_bias"] < 0.5 and 0 <= row["flagged"] <= 1 and 0 <= row["covered_d"] <= 1
    result = pd.DataFrame([row])
    heads, rows = study_table(tissues.TISSUE_STUDY, result)
    assert "flagged" in heads and len(rows[0]) == len(heads)


def test_a_study_retrains_for_each_setting_and_draws_one_figure(bench, tmp_path):
    study = STUDIES["pitch"]
    result = study.table(bench)
    assert list(result["setting"]) == ["1.5 mm (16 rows)", "3 mm (8 rows)"]
    assert result["d_error"].between(0, 0.2).all()
    heads, rows = study_table(study, result)
    assert len(heads) == len(rows[0]) == len(rows[1])
    save_study_figure(study, result, tmp_path / "pitch.svg")
    assert (tmp_path / "pitch.svg").read_text().count("3 mm (8 rows)") == 1


def test_fewer_bits_and_coarser_cells_change_what_the_pipeline_gets(bench):
    some = bench.lumps[:1]
    fine = observe(some, "typical", 3)
    coarse = observe(some, "typical", 3, alter=lambda counts: counts // 64 * 64 + 32)
    assert not np.array_equal(fine.X, coarse.X)
    assert coarse.columns(["ln_base"]) == pytest.approx(fine.columns(["ln_base"]), abs=0.05)


def test_a_study_of_computed_strokes_prints_what_every_interval_covers(fitted, parts, strokes):
    row = computed.covered_row("as trained", fitted, parts[2])
    assert 0.7 < row["covered_t"] <= 1.0 and 0.7 < row["covered_d"] <= 1.0
    heads, rows = study_table(computed.COMPUTED_STUDY, pd.DataFrame([row]))
    assert heads[-5:] == ["F covered", "t covered", "d covered", "h covered", "E_inv23 covered"]
    assert rows[0][-4] == f"{100 * row['covered_t']:.0f}"
    fields = computed.seen_through(strokes.lumps[:2], 1)
    assert [list(f.forces_N_per_m) for f in fields] == [
        [s.F_N_per_m for s in lump.strokes] for lump in strokes.lumps[:2]
    ]
    assert len(computed.cases()) == 7 * computed.LUMPS

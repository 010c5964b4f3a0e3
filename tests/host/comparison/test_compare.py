"""A change between two visits is told from what strokes, and visits, differ by themselves."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from palpate import EmulatedProbe, models
from palpate.answer.fitted import Inverted, Value
from palpate.comparison.between import between_visits, components
from palpate.comparison.refined import change_text
from palpate.dataset.columns import DataSetError
from palpate.dataset.table import DataSet
from palpate.inversion.kept import Kept
from palpate.inversion.recorded import felt_strokes
from palpate.link import emulator_model as emulator
from palpate.link import session
from palpate.sim.probe.noise import LEVELS
from palpate.stroke.change import Between, compare


def visited(lumps, visits, strokes, of_visit, of_stroke, seed=1):
    rng = np.random.default_rng(seed)
    lump = np.repeat(np.arange(lumps), visits * strokes)
    visit = np.repeat(np.arange(lumps * visits), strokes)
    y = rng.uniform(2, 3, lumps)[lump] + of_visit * rng.standard_normal(lumps * visits)[visit]
    return y + of_stroke * rng.standard_normal(len(y)), lump, visit


def test_what_visits_differ_by_is_found():
    found = components(*visited(300, 3, 4, 0.05, 0.03))
    assert found.freedom == 600
    assert found.sd == pytest.approx(0.05, rel=0.06)


def test_scatter_of_strokes_is_not_taken_for_a_visit_s():
    assert components(*visited(300, 3, 4, 0.0, 0.03)).sd < 0.008


def test_one_visit_to_each_lump_tells_nothing():
    assert components(*visited(30, 1, 4, 0.05, 0.03)) is None


def test_intervals_hold_where_nothing_has_changed():
    """Visits that differ by 5 %: intervals that know it hold 0 in 95 of 100; those that do not, far less."""
    rng = np.random.default_rng(1)
    between = components(*visited(40, 2, 3, 0.05, 0.02))
    knowing, plain = [], []
    for _ in range(400):
        a, b = (
            (10 * np.exp(0.05 * rng.standard_normal() + 0.02 * rng.standard_normal(3))).tolist() for _ in "ab"
        )
        knowing.append(compare(a, b, between=between).beyond)
        plain.append(compare(a, b).beyond)
    assert 1 - np.mean(knowing) == pytest.approx(0.95, abs=0.04)
    assert 1 - np.mean(plain) < 0.7


def test_a_doubled_lump_is_beyond_all_of_it():
    found = compare([10, 10.1, 9.9], [20, 20.2, 19.8], between=Between(0.05, 20))
    assert found.beyond and "beyond what visits differ by" in found.text
    assert found.change_low < 10 < found.change_high


def test_a_data_set_without_repeated_visits_is_refused(tmp_path):
    table = pd.DataFrame({"row": [2, 3], "lump": ["A", "B"], "visit": ["1", "1"]})
    with pytest.raises(DataSetError, match="column visit: 2 lumps visited again"):
        between_visits(models.load(), DataSet(tmp_path / "set.csv", table))


def recorded(case, model, path):
    """Two strokes over the case, by an emulated probe with a bundled model."""
    emulated = EmulatedProbe.over(
        case, strokes=2, public_key=emulator.public_key(), model=emulator.image(model)
    )
    with emulated as probe, session.recorded(probe.port, path) as host:
        list(host.stream(strokes=2))
    return path


def compared(*words):
    command = [sys.executable, "-m", "palpate.cli", "compare", *map(str, words), "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    return done.returncode, done.stdout and json.loads(done.stdout), done.stderr


@pytest.fixture(scope="module")
def anywhere(tmp_path_factory):
    return recorded(
        "d12h05e20f06_t12_G4", models.ANYWHERE, tmp_path_factory.mktemp("visits") / "anywhere.mcap"
    )


def test_recordings_are_compared_by_the_model_that_was_on_the_probe(anywhere):
    """It was always `field`, whatever had answered: a ball of 12 mm at 7 mm became one of 9 at 15."""
    status, found, _ = compared(anywhere, anywhere)
    assert status == 0 and found["left_out"] == [0, 0]
    by_name = compared(anywhere, anywhere, "--model", "anywhere")[1]
    assert found == by_name != compared(anywhere, anywhere, "--model", "field")[1]


def test_strokes_that_the_model_does_not_know_are_not_compared(anywhere):
    """Lumps of 12 and 15 mm, both flagged, were said to have shrunk, beyond repeatability."""
    status, _, said = compared(anywhere, anywhere, "--model", "balls")
    assert status == 1 and "lies outside what the model knows" in said


def kept_beside(recording, d_mm):
    """Refined answers of that diameter, to within 6 %, for each stroke of a recording."""
    for stroke, start in felt_strokes(recording):
        around = {
            name: Value(mean, mean / 1.06, mean * 1.06) for name, mean in (("d_mm", d_mm), ("depth_mm", 6.0))
        }
        answer = Inverted(start.stroke, around, "anywhere", {"anywhere": 1.0}, 0.8, True, True)
        Kept(recording).keep([(stroke, start)], LEVELS["typical"], "auto", answer)


def test_refined_answers_that_are_kept_are_compared(anywhere, tmp_path):
    """Each visit as sure as one stroke of it, however many there are."""
    assert compared(anywhere, anywhere)[1]["refined_apart"] == {}
    visits = [shutil.copy(anywhere, tmp_path / f"{name}.mcap") for name in ("january", "may")]
    for path, d_mm in zip(visits, (10.0, 12.0)):
        kept_beside(path, d_mm)
    apart = compared(*visits)[1]["refined_apart"]
    half = np.exp(np.sqrt(2) * np.log(1.06))
    assert apart["d_mm"] == pytest.approx({"value": 1.2, "low": 1.2 / half, "high": 1.2 * half})
    assert apart["depth_mm"]["low"] < 1 < apart["depth_mm"]["high"]
    assert "grew by 20.0 %" in change_text("d_mm", Value(**apart["d_mm"]))
    assert "no change is told" in change_text("depth_mm", Value(**apart["depth_mm"]))


def test_the_forward_model_takes_no_other_model(anywhere):
    status, _, said = compared(anywhere, anywhere, "--refine", "--model", "field")
    assert status == 2 and "--refine takes neither --model nor --data" in said

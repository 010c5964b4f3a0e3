"""A data set's strokes are those that the probe's integers have, or row and column say why not."""

from dataclasses import replace

import numpy as np
import pytest

from palpate import models
from palpate.dataset import table
from palpate.dataset.answers import OUTPUTS, answers
from palpate.dataset.columns import DataSetError
from palpate.dataset.strokes import observe_data_set
from palpate.importing import importer
from palpate.link import emulator_model as emulator
from palpate.stroke.change import ASSUMES_BETWEEN, Between
from palpate.stroke.replay import replay
from palpate.view.visits import Visits
from tests.host.probes import DECLARED, arrays_of


@pytest.fixture(scope="module")
def home(bench, tmp_path_factory):
    """Two strokes over one lump, and the same without their displacement."""
    place = tmp_path_factory.mktemp("set")
    np.savez(place / "a.npz", **arrays_of(bench[0]))
    importer.import_file(place / "a.npz", place / "a.mcap", DECLARED, emulator.image())
    importer.import_file(place / "a.npz", place / "flat.mcap", replace(DECLARED, displacement=""))
    return place


def data(home, rows):
    (home / "set.csv").write_text("recording,stroke,lump,d_mm,depth_mm,place\n" + rows)
    return table.read(home / "set.csv")


def test_answers_are_the_probe_s(home):
    """In float64 what the probe said in integers, to two parts in a thousand."""
    spec = models.load()
    said = answers(
        spec, observe_data_set(data(home, "a.mcap,1,A,12,8.4,border\na.mcap,2,A,12,8.4,border\n"), spec)
    )
    for k, stroke in enumerate(replay(home / "a.mcap")):
        for name, of in stroke.probe.outputs.items():
            j = OUTPUTS.index(name)
            assert said.value[k, j] == pytest.approx(of["value"], rel=2e-3, abs=1e-4)
            assert said.high[k, j] == pytest.approx(of["high"], rel=5e-3, abs=5e-4)
        assert said.lump[k] == stroke.probe.lump and said.hardness[k] == stroke.probe.hardness
    assert said.truth[0, OUTPUTS.index("t_mm")] == pytest.approx(14.4)
    assert np.isnan(said.truth[0, OUTPUTS.index("E_inv23")])


@pytest.mark.parametrize(
    ("rows", "sentence"),
    [
        ("none.mcap,1,A,12,8,\n", "row 2, column recording: there is no recording"),
        (
            "a.mcap,1,A,12,8,\na.mcap,7,A,12,8,\n",
            "row 3, column stroke: a.mcap has no whole stroke 7; it has 1, 2",
        ),
        (
            "flat.mcap,1,A,12,8,\n",
            "row 2, column recording: flat.mcap has no displacement, and the model needs dip_6_10",
        ),
    ],
)
def test_what_a_model_cannot_use(home, rows, sentence):
    with pytest.raises(DataSetError, match=sentence):
        observe_data_set(data(home, rows), models.load())


def test_the_page_counts_what_visits_differ_by():
    visits = Visits("first")
    visits.start("second")
    assert visits.compare(1, 2)["assumes"] != ASSUMES_BETWEEN
    visits.between = {"d_mm": Between(0.05, 10)}
    assert visits.compare(1, 2)["assumes"] == ASSUMES_BETWEEN

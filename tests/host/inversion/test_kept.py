"""Refined answers are kept beside a recording, and only what they were found for gets them again."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from palpate.answer.fitted import Inverted, Laid, Value
from palpate.errors import PalpateError
from palpate.inversion.felt import FeltStroke
from palpate.inversion.kept import Kept
from palpate.inversion.start import MIDDLE
from palpate.sim.probe.noise import LEVELS
from tests.host.inversion.test_inversion import record, refined
from tests.host.inversion.world import felt_of

TYPICAL = LEVELS["typical"]
ANSWER = Inverted(
    3, {"d_mm": Value(12.3, 11.8, None)}, "anywhere", {"none": 0.2, "anywhere": 0.8}, 0.93, True, True,
    "row 4", 1.5, layers={"fat": 1.0},
    laid=(Laid(np.arange(3.0), 1, np.ones((3, 16)), np.zeros((3, 16)), np.ones(3), np.ones(3)),),
)  # fmt: skip


def felt(**changed):
    n = 3
    rows = np.arange(n * 16.0).reshape(n, 16)
    stroke = FeltStroke(rows, np.full(16, 26), np.ones(n), np.arange(n), np.ones(n), np.ones(n), 1, 3)
    return [(replace(stroke, **changed), MIDDLE)]


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "visit.mcap"
    Kept(path).keep(felt(), TYPICAL, "auto", ANSWER)
    return path


def edited(recording, change):
    """The file of answers after somebody's change."""
    path = recording.with_name("visit.mcap.refined")
    document = json.loads(path.read_text())
    change(document["answers"][0])
    path.write_text(json.dumps(document))
    return Kept(recording)


def test_an_answer_comes_back_whole(recording):
    found = Kept(recording).find(felt(), TYPICAL, "auto")
    assert found.as_dict() == ANSWER.as_dict()
    assert np.array_equal(found.laid[0].residual_kPa, np.ones((3, 16))) and found.laid[0].press == 1


def test_other_data_noise_and_class_have_no_answer(recording):
    kept = Kept(recording)
    rows = felt()[0][0].rows_kPa.copy()
    rows[1, 3] += 0.01
    assert kept.find(felt(rows_kPa=rows), TYPICAL, "auto") is None
    assert kept.find(felt(stroke=4), TYPICAL, "auto") is None
    assert kept.find(felt(), LEVELS["good"], "auto") is None
    assert kept.find(felt(), TYPICAL, "border") is None
    assert kept.newest(felt()).chi2 == 0.93
    kept.keep(felt(), TYPICAL, "border", replace(ANSWER, chi2=0.8))
    assert kept.find(felt(), TYPICAL, "auto").chi2 == 0.93
    assert Kept(recording).newest(felt()).chi2 == 0.8


def test_another_version_s_answers_are_noticed_and_go(recording):
    kept = edited(recording, lambda entry: entry["of"].update(inversion="another"))
    assert kept.outdated and kept.find(felt(), TYPICAL, "auto") is None and kept.newest(felt()) is None
    kept.keep(felt(), TYPICAL, "border", ANSWER)
    assert not Kept(recording).outdated


def test_an_answer_with_a_number_that_is_none_is_not_kept(recording):
    """It ended in a traceback of the JSON writer."""
    before = recording.with_name("visit.mcap.refined").read_bytes()
    with pytest.raises(PalpateError, match="stroke 3 is not kept"):
        Kept(recording).keep(felt(), TYPICAL, "border", replace(ANSWER, chi2=float("nan")))
    assert recording.with_name("visit.mcap.refined").read_bytes() == before


@pytest.mark.parametrize("text", ["", "notes of my own", '{"strokes": []}', '{"format": 3}'])
def test_somebody_s_own_file_of_that_name_stays(tmp_path, text):
    path = tmp_path / "visit.mcap.refined"
    path.write_text(text)
    with pytest.raises(PalpateError, match="move it away"):
        Kept(tmp_path / "visit.mcap")
    assert path.read_text() == text


@pytest.mark.long
def test_what_is_refined_beside_a_stream_is_there_for_later(tmp_path):
    """The stroke as it came live is the one that its recording gives."""
    from palpate.sim.tissue import Case

    _, _, stream, calibration = felt_of(Case(11.0, 0.6, 8.0, 0.55), 5)
    path = tmp_path / "visit.mcap"
    live = record(stream, calibration, path, "--refine")
    assert f"kept in {path}.refined" in live.stderr and "refined: stroke 1" in live.stdout
    before = (tmp_path / "visit.mcap.refined").read_bytes()
    assert "1 of them from before" in refined(path).stdout
    assert (tmp_path / "visit.mcap.refined").read_bytes() == before


def test_those_who_refine_one_recording_at_once_lose_none_of_their_answers(tmp_path):
    """Each had read the file before the other wrote it."""
    path = tmp_path / "visit.mcap"

    def keep(some):
        for number in some:
            Kept(path).keep(felt(stroke=number), TYPICAL, "auto", replace(ANSWER, stroke=number))

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(keep, [range(k, k + 8) for k in range(0, 32, 8)]))
    kept = Kept(path)
    assert all(kept.find(felt(stroke=number), TYPICAL, "auto").stroke == number for number in range(32))
    assert [one.name for one in tmp_path.iterdir()] == ["visit.mcap.refined"]

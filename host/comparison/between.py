"""What visits differ by, from lumps that were visited again; and two recordings compared, by which model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from palpate.dataset.answers import OUTPUTS, JudgedAnswers, answers
from palpate.dataset.columns import DataSetError
from palpate.dataset.strokes import observe_data_set, read_strokes
from palpate.dataset.table import DataSet
from palpate.errors import RecordingError
from palpate.features.map_features import Floats
from palpate.model_export.schema import ModelSpec
from palpate.progress import ProgressCallback
from palpate.recording.channels import MODEL
from palpate.recording.reader import Recording
from palpate.stroke.change import QUANTITIES, Between, Comparison, compare
from palpate.stroke.documents import Documents

FEWEST = 2
"""Visits beyond the first, over all lumps, that say what visits differ by."""
_NAME_IT = "name one with --model, as --model balls or --model model.json"


def between_visits(
    spec: ModelSpec, data: DataSet, progress: ProgressCallback | None = None
) -> dict[str, Between]:
    """What each quantity differs by from visit to visit, from the data set's lumps with two visits or more.

    Raises
    ------
    DataSetError
        No lump, or too few, were visited twice; or a recording cannot be used: row and column.
    """
    visits = data.table.groupby("lump")["visit"].transform("nunique")
    if int((data.table.groupby("lump")["visit"].nunique() - 1).sum()) < FEWEST:
        raise DataSetError(
            f"{data.path}, column visit: {FEWEST} lumps visited again, or one {FEWEST + 1} times, are needed "
            "to tell what visits differ by"
        )
    seen = observe_data_set(data.only(visits.to_numpy() > 1), spec, progress)
    said = answers(spec, seen)
    visit = seen.table["lump"].astype(str) + "\0" + seen.table["visit"].astype(str)
    number = np.asarray(pd.factorize(visit)[0], np.int64)
    out = {}
    for name in QUANTITIES:
        value = said.value[:, OUTPUTS.index(name)]
        # of lumps that the model does not know, too: what visits differ by is the probe's and the hand's
        used = said.lump & (value > 0)
        found = components(np.log(value[used]), said.group[used], number[used])
        if found is not None:
            out[name] = found
    return out


def components(y: Floats, lump: NDArray[np.int64], visit: NDArray[np.int64]) -> Between | None:
    """The variance of visits within lumps, by the nested analysis of variance; None from too few visits.

    Parameters
    ----------
    y, lump, visit : (n,)
        Visits of different lumps have different numbers.
    """
    table = pd.DataFrame({"y": y, "lump": lump, "visit": visit})
    visits = table.groupby("visit").agg(lump=("lump", "first"), mean=("y", "mean"), n=("y", "size"))
    again = visits.groupby("lump")["mean"].transform("size") > 1
    visits = visits[again]
    freedom = len(visits) - visits["lump"].nunique()
    if freedom < FEWEST:
        return None
    own = visits["mean"] - visits.groupby("lump")["mean"].transform("mean")
    inside = table["y"] - table.groupby("visit")["y"].transform("mean")
    strokes = len(table) - table["visit"].nunique()
    within = float((inside**2).sum() / strokes) if strokes else 0.0
    # a visit's mean carries its strokes' scatter as well
    excess = float((own**2).sum()) / freedom - within * float((1 / visits["n"]).mean())
    return Between(float(np.sqrt(max(excess, 0.0))), int(freedom))


@dataclass(frozen=True)
class VisitPair:
    """Two recordings, quantity by quantity.

    Attributes
    ----------
    changes : dict of Comparison
    between : dict of Between
        What was counted in; empty where no data set was given.
    left_out : (int, int)
        Strokes of either recording that show a lump but lie outside what the model knows.
    """

    changes: dict[str, Comparison]
    between: dict[str, Between]
    left_out: tuple[int, int]


def compare_recordings(
    spec: ModelSpec, first: Path, second: Path, between: dict[str, Between] | None = None
) -> VisitPair:
    """Compare the strokes of two recordings over one lump, by a model.

    Raises
    ------
    RecordingError
        A recording shows no lump, or none that the model knows.
    """
    between = between or {}
    said = [_answers(spec, path) for path in (first, second)]
    changes = {}
    for name, (what, unit) in QUANTITIES.items():
        a, b = (s.value[s.usable, OUTPUTS.index(name)].tolist() for s in said)
        found = compare(a, b, what=what, unit=unit, between=between.get(name))
        if found is not None:
            changes[name] = found
    before, after = (int((s.lump & ~s.usable).sum()) for s in said)
    return VisitPair(changes, between, (before, after))


def _answers(spec: ModelSpec, path: Path) -> JudgedAnswers:
    numbers = list(read_strokes(path))
    table = pd.DataFrame({"row": 1, "recording": [path] * len(numbers), "stroke": numbers, "lump": "here"})
    said = answers(spec, observe_data_set(DataSet(path, table), spec))
    if not said.lump.any():
        raise RecordingError(f"no stroke of {path} shows a lump that the model can size")
    if not said.usable.any():
        raise RecordingError(
            f"every stroke of {path} over a lump lies outside what the model knows (`palpate replay {path}` "
            "says why); name a model for such lumps with --model"
        )
    return said


def common_model(first: Path, second: Path) -> ModelSpec:
    """The document of the model that answered in both recordings.

    Raises
    ------
    RecordingError
        A recording has no model image, or nobody here has the document of its model; or the two differ.
    """
    one, other = (_recorded_model(path) for path in (first, second))
    if one.training["hash"] != other.training["hash"]:
        raise RecordingError(f"{first} and {second} were recorded with different models; {_NAME_IT}")
    return one


def _recorded_model(path: Path) -> ModelSpec:
    image = Recording(path).attachment(MODEL)
    if not image:
        raise RecordingError(f"{path} does not say which model was on the probe; {_NAME_IT}")
    documents = Documents()
    documents.learn(image)
    if documents.answering is None:
        raise RecordingError(f"the model in {path} is none of those that come with Palpate; {_NAME_IT}")
    return documents.answering

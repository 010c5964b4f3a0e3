"""The whole of a validation: agreement of every output, hardness, what was not found, flags, verdicts."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd

from palpate.dataset.agreement import Agreement, Estimated, agreement, wilson
from palpate.dataset.answers import NAMES, OUTPUTS, JudgedAnswers, answers
from palpate.dataset.strokes import observe_data_set
from palpate.dataset.table import DataSet
from palpate.model_export.schema import ModelSpec
from palpate.progress import ProgressCallback
from palpate.validation.verdict import Verdict, verdict


@dataclass(frozen=True)
class Validation:
    """What a data set shows of a model.

    Attributes
    ----------
    answers : JudgedAnswers
    agreements : dict of Agreement
        By output; those without a truth are missing.
    verdicts : dict of Verdict
        The same.
    confusion : DataFrame
        Rows hard and soft as they are, columns hard, soft, unsure as said; strokes.
    not_found, flagged, force_out : Estimated
        Shares: of all strokes; of those found.
    wrong_hardness : Estimated or None
        Share of the strokes called hard or soft that are the other.
    remarks : tuple of str
        The data set's.
    """

    answers: JudgedAnswers
    agreements: dict[str, Agreement]
    verdicts: dict[str, Verdict]
    confusion: pd.DataFrame
    not_found: Estimated
    flagged: Estimated
    force_out: Estimated
    wrong_hardness: Estimated | None
    remarks: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        outputs = {}
        for name, found in self.agreements.items():
            row = {k: v for k, v in asdict(found).items() if k not in ("errors", "means", "name")}
            row["limits"] = {"low": asdict(found.limits[0]), "high": asdict(found.limits[1])}
            outputs[name] = row | {
                "verdict": self.verdicts[name].text,
                "more_lumps": self.verdicts[name].more_lumps,
            }
        return {
            "strokes": len(self.answers.group),
            "lumps": len(np.unique(self.answers.group)),
            "level": self.answers.level,
            "outputs": outputs,
            "hardness": {
                k: {str(i): int(n) for i, n in v.items()} for k, v in self.confusion.T.to_dict().items()
            },
            "wrong_hardness": None if self.wrong_hardness is None else asdict(self.wrong_hardness),
            "not_found": asdict(self.not_found),
            "out_of_domain": asdict(self.flagged),
            "force_out": asdict(self.force_out),
            "remarks": list(self.remarks),
        }


def validate(
    spec: ModelSpec,
    data: DataSet,
    seed: int = 1,
    progress: ProgressCallback | None = None,
) -> Validation:
    """Judge a model by a data set.

    Parameters
    ----------
    spec : ModelSpec
    data : DataSet
        Its truths lie within the model's ranges (`dataset.answers.refuse_outside`).
    seed : int
        Of the resampling.
    progress : callable, optional
        See `palpate.progress.ProgressCallback`.

    Raises
    ------
    DataSetError
        A recording cannot be used; row and column.
    """
    said = answers(spec, observe_data_set(data, spec, progress))
    found = {name: agreement(said, name, seed) for name in NAMES if name in OUTPUTS}
    agreements = {name: a for name, a in found.items() if a is not None}
    confusion, wrong = _hardness(said)
    return Validation(
        said,
        agreements,
        {name: verdict(a, said.level) for name, a in agreements.items()},
        confusion,
        share(~said.lump),
        share(~said.in_domain[said.lump]),
        share(said.force_out[said.lump]),
        wrong,
        data.remarks,
    )


def share(hits: np.ndarray) -> Estimated:
    """A share of strokes with Wilson's interval."""
    return wilson(hits.sum(), len(hits)) if len(hits) else Estimated(float("nan"))


def _hardness(said: JudgedAnswers) -> tuple[pd.DataFrame, Estimated | None]:
    judged = said.known("E_inv23")
    truth = np.where(said.hard[judged], "hard", "soft")
    words = said.hardness[judged]
    table = pd.crosstab(truth, words).reindex(["hard", "soft"], fill_value=0)
    table = table.reindex(["hard", "soft", "unsure"], axis=1, fill_value=0)
    decided = words != "unsure"
    return table, share(words[decided] != truth[decided]) if decided.any() else None

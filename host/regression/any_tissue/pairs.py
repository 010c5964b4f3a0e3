"""Two lumps side by side look like one that is wider: the check that tells them, and what it leaves.

Pairs are superposed (`sim.probe.two_lumps`): the changes that each lump makes, on the tissue without one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from palpate.model_export.fixed_point.reference import estimates
from palpate.model_export.schema import FirstStage
from palpate.regression.any_tissue.model import (
    ON_BORDER,
    OUTPUTS,
    Scope,
    TissueModel,
    fit_tissue_model,
    input_names,
    truth,
)
from palpate.regression.any_tissue.observed import ObservedInTissue, TissueLump, observe
from palpate.regression.checks import fit_checks
from palpate.sim.probe.two_lumps import APART_MM

FEATURES, TERMS = 12, 40
"""Of the check; the board has room for so many beside both stages."""

DISTANCES_MM = (8.0, 12.0, 16.0, 20.0, 30.0)
_FIRST_SEED = 70

Observed = Callable[[Sequence[TissueLump], tuple[float, float], int], ObservedInTissue]


def observer(noise: str, seed: int, blob: bytes) -> Observed:
    """Observes pairs of lumps so far apart; the last argument tells draws apart."""
    return lambda lumps, apart, draw: observe(
        lumps, noise, 1000 * seed + _FIRST_SEED + draw, blob, two_apart_mm=apart
    )


def pair_check(model: TissueModel, seen: ObservedInTissue, pairs: ObservedInTissue) -> FirstStage:
    """A check that is above 0 over two lumps; ln F has no part in it, so that it is the same in every fat."""
    own, other = seen.take(seen.found), pairs.take(pairs.found)
    return fit_checks(
        input_names(True)[:-1],
        model.inputs(own)[:, :-1],
        own.group,
        {"two_lumps": (model.inputs(other)[:, :-1], other.group)},
        most_features=FEATURES,
        most_terms=TERMS,
    )


def unlike(check: FirstStage, model: TissueModel, seen: ObservedInTissue) -> np.ndarray:
    """Whether the check is above 0, (n)."""
    at = [input_names(True).index(name) for name in check.features]
    return np.asarray((estimates(check, model.inputs(seen)[:, at]) > 0).any(axis=1))


def pairs_table(
    lumps: Sequence[TissueLump],
    seen: ObservedInTissue,
    rim: ObservedInTissue,
    watch: Observed,
    scope: Scope = ON_BORDER,
) -> pd.DataFrame:
    """Pairs of lumps that neither model nor check has met: half of the lumps for each.

    Returns
    -------
    DataFrame
        Rows: single lumps, then pairs by distance. Columns: strokes that find a lump, share flagged, share
        whose interval of d holds neither lump, and of these without a flag, without and with the check.
    """
    half = seen.group % 2 == 0
    train, test = seen.take(half), seen.take(~half & seen.found)
    model = fit_tissue_model(train, True, rim, scope=scope)
    fit_to = watch(lumps, APART_MM, 0)
    check = pair_check(model, train, fit_to.take(fit_to.group % 2 == 0))
    rows = [pairs_row("one lump", model, check, test)]
    for k, apart in enumerate(DISTANCES_MM):
        pairs = watch(lumps, (apart, apart), 1 + k)
        rows.append(
            pairs_row(
                f"two, {apart:g} mm apart", model, check, pairs.take((pairs.group % 2 == 1) & pairs.found)
            )
        )
    return pd.DataFrame(rows)


def pairs_row(words: str, model: TissueModel, check: FirstStage, seen: ObservedInTissue) -> dict[str, object]:
    """A row of `pairs_table`, of strokes that find a lump."""
    said, d = model.answer(seen), OUTPUTS.index("ln d")
    wrong = np.abs(said.y[:, d] - truth(seen)[:, d]) > said.half[:, d]
    flagged = ~model.in_domain(seen)
    both = flagged | unlike(check, model, seen)
    return {
        "strokes": words,
        "n": len(wrong),
        "flagged": float(both.mean()),
        "d_missed": float(wrong.mean()),
        "silent_before": float((wrong & ~flagged).mean()),
        "silent": float((wrong & ~both).mean()),
    }

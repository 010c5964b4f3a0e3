"""Strokes that look like one lump in even tissue and are not: the checks that tell them, and what they leave.

Two lumps side by side look like one that is wider. They are superposed (`sim.probe.two_lumps`): the changes
that each lump makes, on the tissue without one. Where the tissue's thickness undulates along the stroke, a
lump's size and depth come out wrong, and plain tissue looks like a lump (`Noise.undulation`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from palpate.learn.checks import fit_checks
from palpate.learn.lumps import LumpStrokes
from palpate.learn.model import FittedModel, fit_model
from palpate.learn.observed import Observed, joined, noise_named, observe_in_any_fat
from palpate.learn.probe_model import OUTPUTS
from palpate.learn.scopes import BORDER, Scope
from palpate.learn.score import share
from palpate.model_export.schema import FirstStage
from palpate.sim.probe.sensors import Noise
from palpate.sim.probe.two_lumps import APART_MM

FEATURES, TERMS = 12, 50
"""Of the checks; the board has room for so many beside both stages."""

DISTANCES_MM = (8.0, 12.0, 16.0, 20.0, 30.0)
UNDULATIONS = (0.02, 0.05, 0.1)
"""What the checks are judged by."""

_LUMPS_UNDULATE, _PLAIN_UNDULATES = 0.1, (0.03, 0.05, 0.1)
"""What they are fitted to: less of it under a lump cannot be told, and would cost those in even tissue."""

_PAIRS_SEED, _UNEVEN_SEED, _PLAIN_SEED = 70, 80, 90


@dataclass(frozen=True)
class StrangeStrokes:
    """Observes what a model is not for, with sensors of its own noise; `draw` tells draws apart."""

    noise: Noise | str
    seed: int
    force_map: bytes

    def pairs(self, lumps: Sequence[LumpStrokes], apart_mm: tuple[float, float], draw: int = 0) -> Observed:
        """Two lumps of a kind, so far apart."""
        return observe_in_any_fat(
            lumps, self.noise, self._seed(_PAIRS_SEED, draw), self.force_map, two_apart_mm=apart_mm
        )

    def uneven(
        self, lumps: Sequence[LumpStrokes], undulation: float, draw: int = 0, first: int = _UNEVEN_SEED
    ) -> Observed:
        """Tissue whose thickness undulates by this share."""
        noise = noise_named(self.noise).with_(undulation=undulation)
        return observe_in_any_fat(lumps, noise, self._seed(first, draw), self.force_map)

    def uneven_plain(self, plain: Sequence[LumpStrokes], undulation: float, draw: int = 0) -> Observed:
        """The same without a lump; their numbers are below 0."""
        seen = self.uneven(plain, undulation, draw, _PLAIN_SEED)
        return replace(seen, group=-1 - seen.group)

    def _seed(self, first: int, draw: int) -> int:
        return 1000 * self.seed + first + draw


def observe_strange(
    watch: StrangeStrokes, lumps: Sequence[LumpStrokes], plain: Sequence[LumpStrokes]
) -> dict[str, Observed]:
    """Strokes for checks to be fitted to, by kind."""
    uneven = [watch.uneven(lumps, _LUMPS_UNDULATE)]
    uneven += [watch.uneven_plain(plain, by, k) for k, by in enumerate(_PLAIN_UNDULATES)]
    return {"two_lumps": watch.pairs(lumps, APART_MM), "uneven_tissue": joined(uneven)}


def strange_checks(model: FittedModel, seen: Observed, strange: dict[str, Observed]) -> FirstStage:
    """A check for each kind; ln F has no part in them, so that they are the same in every fat."""
    own = seen.take(seen.found)
    others = {kind: other.take(other.found) for kind, other in strange.items()}
    return fit_checks(
        model.polynomial.names[:-1],
        model.inputs(own)[:, :-1],
        own.group,
        {kind: (model.inputs(other)[:, :-1], other.group) for kind, other in others.items()},
        most_features=FEATURES,
        most_terms=TERMS,
    )


def strange_table(
    lumps: Sequence[LumpStrokes],
    plain: Sequence[LumpStrokes],
    seen: Observed,
    rim: Observed,
    watch: StrangeStrokes,
    strange: dict[str, Observed],
    scope: Scope = BORDER,
) -> pd.DataFrame:
    """What becomes of strokes that neither model nor checks have met: half of the lumps for each.

    Parameters
    ----------
    strange : dict
        What the checks are fitted to, of `observe_strange` with these lumps and tissues.

    Returns
    -------
    DataFrame
        Of `strange_rows`, with single lumps first.
    """
    half = seen.group % 2 == 0
    train, test = seen.take(half), seen.take(~half)
    model = fit_model(scope, train, rim=rim)
    check = strange_checks(
        model, train, {kind: other.take(other.group % 2 == 0) for kind, other in strange.items()}
    )
    return strange_rows(replace(model, checks=check), test, lumps, plain, watch, odd=True)


def strange_rows(
    model: FittedModel,
    own: Observed,
    lumps: Sequence[LumpStrokes],
    plain: Sequence[LumpStrokes],
    watch: StrangeStrokes,
    odd: bool = False,
) -> pd.DataFrame:
    """Single lumps, pairs by distance, undulating tissue with and without a lump; `odd`: every other lump.

    Returns
    -------
    DataFrame
        Columns: strokes that find a lump, share flagged, share whose interval of d holds no lump that is
        there, and of these without a flag, without and with the checks.
    """
    rows = [_row("one lump", model, own)]

    def add(words: str, seen: Observed) -> None:
        rows.append(_row(words, model, seen.take(seen.group % 2 == 1) if odd else seen))

    for k, apart in enumerate(DISTANCES_MM):
        add(f"two, {apart:g} mm apart", watch.pairs(lumps, (apart, apart), 1 + k))
    for k, by in enumerate(UNDULATIONS):
        add(f"one, thickness undulates by {100 * by:g} %", watch.uneven(lumps, by, 1 + k))
    for k, by in enumerate(UNDULATIONS):
        draw = 1 + len(_PLAIN_UNDULATES) + k
        add(f"none, thickness undulates by {100 * by:g} %", watch.uneven_plain(plain, by, draw))
    return pd.DataFrame(rows)


def _row(words: str, model: FittedModel, seen: Observed) -> dict[str, object]:
    """Of those that find a lump; where there is none to find every one of them is wrong."""
    seen = seen.take(seen.found)
    said, d = model.answer(seen), OUTPUTS.index("ln d")
    wrong = np.abs(said.y - seen.truth)[:, d] > said.half[:, d]
    wrong |= seen.group < 0
    shares = {
        "flagged": ~said.in_domain,
        "d_missed": wrong,
        "silent_before": wrong & said.familiar,
        "silent": wrong & said.in_domain,
    }
    return {
        "strokes": words,
        "n": len(wrong),
        **{name: share(of) for name, of in shares.items()},
    }

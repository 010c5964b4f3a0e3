"""Strokes that look like one lump in even tissue and are not: the checks that tell them, and what they leave.

Two lumps side by side look like one that is wider. They are superposed (`sim.probe.two_lumps`): the changes
that each lump makes, on the tissue without one. Where the tissue's thickness undulates along the stroke, a
lump's size and depth come out wrong, and plain tissue looks like a lump (`Noise.undulation`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.learn.checks import fit_checks
from palpate.learn.lumps import LumpStrokes
from palpate.learn.model import FittedModel, fit_model
from palpate.learn.observed import Observed, joined, noise_named, observe_in_any_fat, own_fat
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
_FAT_SEED, _OTHER_SEED = {"softer": 800, "stiffer": 850}, 870


@dataclass(frozen=True)
class StrangeStrokes:
    """Observes what a model is not for, with sensors of its own noise; `draw` tells draws apart.

    told: each lump in the fat that it was simulated in, which the model is told, not in one at random.
    """

    noise: Noise | str
    seed: int
    force_map: bytes
    told: bool = False

    def pairs(self, lumps: Sequence[LumpStrokes], apart_mm: tuple[float, float], draw: int = 0) -> Observed:
        """Two lumps of a kind, so far apart."""
        return self._seen(lumps, self.noise, _PAIRS_SEED + draw, two_apart_mm=apart_mm)

    def uneven(
        self, lumps: Sequence[LumpStrokes], undulation: float, draw: int = 0, first: int = _UNEVEN_SEED
    ) -> Observed:
        """Tissue whose thickness undulates by this share."""
        noise = noise_named(self.noise).with_(undulation=undulation)
        return self._seen(lumps, noise, first + draw)

    def uneven_plain(self, plain: Sequence[LumpStrokes], undulation: float, draw: int = 0) -> Observed:
        """The same without a lump; their numbers are below 0."""
        seen = self.uneven(plain, undulation, draw, _PLAIN_SEED)
        return replace(seen, group=-1 - seen.group)

    def in_fat(self, lumps: Sequence[LumpStrokes], factors: Floats, kind: str, draw: int = 0) -> Observed:
        """Each in fat stiffer than its own by a factor, and pressed as much harder."""
        fat_kPa = factors * own_fat(lumps)
        return self._seen(lumps, self.noise, _FAT_SEED[kind] + draw, fat_kPa=fat_kPa.tolist())

    def as_they_are(self, lumps: Sequence[LumpStrokes], draw: int = 0) -> Observed:
        """Each as it was simulated, which is what is strange about it."""
        return self._seen(lumps, self.noise, _OTHER_SEED + draw)

    def _seen(self, lumps: Sequence[LumpStrokes], noise: Noise | str, first: int, **how: Any) -> Observed:
        seed = 1000 * self.seed + first
        return observe_in_any_fat(lumps, noise, seed, self.force_map, told=self.told, **how)


def observe_strange(
    watch: StrangeStrokes, lumps: Sequence[LumpStrokes], plain: Sequence[LumpStrokes]
) -> dict[str, Observed]:
    """Strokes for checks to be fitted to, by kind."""
    two = {"two_lumps": watch.pairs(lumps, APART_MM)}
    if watch.told:  # a probe has room for three checks, and such a model has two by the press
        return two
    uneven = [watch.uneven(lumps, _LUMPS_UNDULATE)]
    uneven += [watch.uneven_plain(plain, by, k) for k, by in enumerate(_PLAIN_UNDULATES)]
    return two | {"uneven_tissue": joined(uneven)}


def strange_checks(model: FittedModel, seen: Observed, strange: dict[str, Observed]) -> FirstStage:
    """A check for each kind; ln F has no part in them, so that they are the same in every fat."""
    some = [k for k, name in enumerate(model.polynomial.names) if name != "ln_force"]
    found = {kind: of.take(of.found) for kind, of in ({"own": seen} | strange).items()}
    X = {kind: (model.inputs(of)[:, some], of.group) for kind, of in found.items()}
    names = [model.polynomial.names[k] for k in some]
    return fit_checks(names, *X.pop("own"), X, most_features=FEATURES, most_terms=TERMS)


def strange_table(
    lumps: Sequence[LumpStrokes],
    plain: Sequence[LumpStrokes],
    seen: Observed,
    rim: Observed,
    watch: StrangeStrokes,
    strange: dict[str, Observed],
    scope: Scope = BORDER,
) -> pd.DataFrame:
    """What becomes of strokes that neither model nor checks have met: every third lump judges.

    Parameters
    ----------
    strange : dict
        What the checks are fitted to, of `observe_strange` with these lumps and tissues.

    Returns
    -------
    DataFrame
        Of `strange_rows`, with single lumps first.
    """
    test = _judging(seen)
    train = seen.take(~test)
    model = fit_model(scope, train, rim=rim)
    check = strange_checks(
        model, train, {kind: other.take(~_judging(other)) for kind, other in strange.items()}
    )
    return strange_rows(replace(model, checks=check), seen.take(test), lumps, plain, watch, some=True)


def _judging(seen: Observed) -> NDArray[np.bool_]:
    """(n), every third lump: every other one of a Sobol sequence would be those of one end of a range."""
    return seen.group % 3 == 0


def strange_rows(
    model: FittedModel,
    own: Observed,
    lumps: Sequence[LumpStrokes],
    plain: Sequence[LumpStrokes],
    watch: StrangeStrokes,
    some: bool = False,
) -> pd.DataFrame:
    """Single lumps, pairs by distance, undulating tissue with and without a lump; `some`: those that judge.

    Returns
    -------
    DataFrame
        Columns: strokes that find a lump, share flagged, share whose interval of d holds no lump that is
        there, and of these without a flag, without and with the checks.
    """
    rows = [_row("one lump", model, own)]

    def add(words: str, seen: Observed) -> None:
        rows.append(_row(words, model, seen.take(_judging(seen)) if some else seen))

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
    wrong = np.abs(said.y[:, d] - seen.truth[:, d]) > said.half[:, d]
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

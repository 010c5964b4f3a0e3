"""What a fitted model consists of, in float64.

Units: features as the firmware names them, outputs as `OUTPUTS` says. With the names of the formulas below,

    x  = min(max(feature, clip_lo), clip_hi)          z = (x - centre) / scale
    y_j = sum_k coefficients[j][k] * prod_{i in terms[k]} z_i         (the link scale: ln or identity)
    y_j is then clipped to [lo_j, hi_j]; value_j = exp(y_j) or y_j
    ln sigma_j = sum_k sigma[j][k] * prod_{i in sigma_terms[k]} z_i + sum_m sigma[j][K + m] * y_m
    low_j, high_j = link^-1(y_j -+ quantile[j][class] * sigma_j), clipped to [lo_j, hi_j]

with class 1 where the predicted E_inv23 is below the hardness threshold (a hard lump), 0 otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from palpate.model_export.vocabulary import Term


@dataclass(frozen=True)
class Output:
    """One output: its link and its coefficients over the shared terms.

    Attributes
    ----------
    name : str
        One of the names of `OUTPUTS`.
    link : str
        "ln": the polynomial gives the logarithm of the value in the output's unit; "identity": the value.
    lo, hi : float
        The range that predictions and intervals are clipped to, in the output's unit; for "ln" lo > 0.
    coefficients : tuple of float
        One for each of the model's terms, over standardised features.
    """

    name: str
    link: str
    lo: float
    hi: float
    coefficients: tuple[float, ...]


@dataclass(frozen=True)
class Interval:
    """Normalised conformal intervals: a quantile per output and predicted class times sigma.

    Attributes
    ----------
    level : float
        Coverage the quantiles were taken for, 0 < level < 1.
    terms : tuple of Term
        Monomials of ln sigma, `()` for the constant.
    coefficients : tuple of tuple of float
        For each output: one per term, then one per output (its clipped prediction on the link scale).
    quantiles : tuple of (float, float)
        For each output: for lumps predicted soft, and predicted hard. 0 is allowed (no interval).
    """

    level: float
    terms: tuple[Term, ...]
    coefficients: tuple[tuple[float, ...], ...]
    quantiles: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Domain:
    """Where the model is valid: a box in feature units, a distance, ranges of the estimates.

    in_domain = lo <= feature <= hi for all, and (z - m)' precision (z - m) <= threshold, m the centre, and
    range_lo_j - margin half_j <= y_j <= range_hi_j + margin half_j for all outputs, where half_j is half the
    interval of y_j, all on the link scale. A range is in the output's unit; None where it has no such end.
    """

    lo: tuple[float, ...]
    hi: tuple[float, ...]
    centre: tuple[float, ...]
    precision: tuple[tuple[float, ...], ...]
    threshold: float
    ranges: tuple[tuple[float | None, float | None], ...]
    margin: float


@dataclass(frozen=True)
class Limit:
    """One condition of the lump rule: lo <= feature <= hi; any feature of the firmware, None for no bound."""

    feature: str
    lo: float | None = None
    hi: float | None = None


@dataclass(frozen=True)
class Estimate:
    """A value of the first stage, which the second takes as a feature of that name.

    Attributes
    ----------
    name : str
        None of `firmware_py.feature_names.NAMES`.
    lo, hi : float
        What it is held within.
    coefficients : tuple of float
        One for each of the stage's terms, over standardised features.
    """

    name: str
    lo: float
    hi: float
    coefficients: tuple[float, ...]


@dataclass(frozen=True)
class Joining:
    """How a reference press joins the stroke's own: with d = the reference's estimates less the press's,

    they become press + weights d, unless |triangle d|^2 > limit: then it is of another place.

    Attributes
    ----------
    weights : tuple of float
        One for each estimate, 0 to 1.
    triangle : tuple of tuple of float
        Three rows of one, two and three numbers, within +-500.
    limit : float
        At most 500.
    """

    weights: tuple[float, ...]
    triangle: tuple[tuple[float, ...], ...]
    limit: float


@dataclass(frozen=True)
class FirstStage:
    """Polynomials that are worked out beside the model's own, as those are; their values are held, no more.

    Attributes
    ----------
    features, centre, scale, clip_lo, clip_hi, terms : as the model's
    estimates : tuple of Estimate
        One to three.
    joining : Joining or None
        Where the three are ln F/E_fat, ln t and one more, and a reference press may join them.
    """

    features: tuple[str, ...]
    centre: tuple[float, ...]
    scale: tuple[float, ...]
    clip_lo: tuple[float, ...]
    clip_hi: tuple[float, ...]
    terms: tuple[Term, ...]
    estimates: tuple[Estimate, ...]
    joining: Joining | None = None


@dataclass(frozen=True)
class Across:
    """What the host adds to the probe's answer about a solid lump: width and place across the stroke.

    With z the standardised features of `width`, y its estimate, and a Gaussian through the columns' responses
    (`palpate.answer.across`) that lies at x mm:

        width = exp(y), from exp(y - w) to exp(y + w),     ln w = width_spread . (1, z_1, .., z_n, y)
        place = place_stretch x -+ p,                      ln p = place_spread . (1, ln_blur)

    Attributes
    ----------
    level : float
        Coverage of both intervals, 0 < level < 1; the place's over lumps beside the line.
    width : FirstStage
        Of features among the model's own; its one estimate is ln of the width, mm.
    width_spread : tuple of float
        As many as `width` has features, and two.
    place_stretch : float
        A curved face shows bumps nearer to its middle than they are.
    place_spread : (float, float)
    """

    level: float
    width: FirstStage
    width_spread: tuple[float, ...]
    place_stretch: float
    place_spread: tuple[float, float]


@dataclass(frozen=True)
class Layers:
    """What the host adds to the probe's answer about a lump that need not lie on the border of fat and gland.

    With t, d, h and E what the probe says, E its E_inv23, and z the model's standardised features:

        in_fat = t / d - h, held within -1 and 2      how much of the lump's height lies in the fat
        depth  = d h
        size   = ln d + slope E                       known where d and E alone are not
        w_q    = quantiles[q][layer] exp(spread[q] . (1, z_1, .., z_n, q))

    with w half of the interval of q, which is in_fat, ln depth or size, 8 at most; layer is 0 where in_fat is
    1 or more (in the fat), 2 where it is 0 or less (in the gland), 1 between. So d, for one who knows E, is
    exp(size - slope E -+ w). The odds of the layers are those of a normal distribution about in_fat of which
    -+ w holds `level`.

    Attributes
    ----------
    level : float
        Coverage of the intervals, 0 < level < 1.
    slope : float
        By how much ln d is off where E is off by one, turned round.
    spread : three tuples of float
        Each as long as the model has features, and two.
    quantiles : three triples of float
    sure : float
        The layer is said where it has these odds, over 1/2.
    """

    level: float
    slope: float
    spread: tuple[tuple[float, ...], ...]
    quantiles: tuple[tuple[float, float, float], ...]
    sure: float


@dataclass(frozen=True)
class ModelData:
    """A whole fitted model as plain data; `schema.ModelSpec` checks it, reads it and writes it.

    Attributes
    ----------
    kind : str
        "thesis" or "field".
    probe : str
        Identity of the probe: `firmware_py.model_image.PROBE`, at most 16 ASCII characters.
    features_version : int
        `firmware_py.features.FEATURES_VERSION` of the features that the model was trained on.
    features : tuple of str
        Names out of `firmware_py.feature_names.NAMES`, and of the first stage's estimates.
    centre, scale, clip_lo, clip_hi : tuple of float
        Per feature, in the feature's unit.
    terms : tuple of Term
        Monomials as tuples of indices into `features`, sorted, `()` for the constant; degree at most 3.
    outputs : tuple of Output
        All five, in the order of `OUTPUTS`.
    interval : Interval
    domain : Domain
    lump : tuple of Limit
        A stroke shows a lump only if every condition holds; empty: always.
    hard_below : float
        E_inv23 under which a lump is called hard.
    force_range : (float, float)
        F_N_per_m that the model was trained over.
    force_map : dict or None
        Opaque here: `palpate.model_export.integers.force_map` turns it into the firmware's table.
    training : dict
        At least "hash" (64 hex digits) and "n"; noise level, seed and scores are welcome.
    first : FirstStage or None
        None: the model has one stage.
    checks : FirstStage or None
        Its estimates say what a stroke is unlike: where one of them is above 0 it is outside the domain. Of
        features among the model's own.
    across : Across or None
        No part of the image: the host works it out.
    layers : Layers or None
        Nor is this.
    """

    kind: str
    probe: str
    features_version: int
    features: tuple[str, ...]
    centre: tuple[float, ...]
    scale: tuple[float, ...]
    clip_lo: tuple[float, ...]
    clip_hi: tuple[float, ...]
    terms: tuple[Term, ...]
    outputs: tuple[Output, ...]
    interval: Interval
    domain: Domain
    lump: tuple[Limit, ...]
    hard_below: float
    force_range: tuple[float, float]
    training: dict[str, Any]
    force_map: dict[str, Any] | None = None
    notes: dict[str, Any] = field(default_factory=dict)
    first: FirstStage | None = None
    checks: FirstStage | None = None
    across: Across | None = None
    layers: Layers | None = None

"""ModelSpec to the integer tables of `firmware_py.evaluator`.

Features become u in +-1 over the clip box, so that every monomial stays in +-1 (Q28); coefficients
are rescaled accordingly; nested.py puts the terms in the order in which they are evaluated, quantise.py
splits the coefficients into words.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence

import numpy as np

from firmware_py import evaluator as ev
from firmware_py import feature_names, stage, unpack
from firmware_py import features as firmware_features
from palpate.fixedpoint import nested, quantise
from palpate.fixedpoint import word_pairs as words
from palpate.fixedpoint.form import Form
from palpate.fixedpoint.word_pairs import Row, Words, to_word
from palpate.model_export.errors import ModelError
from palpate.model_export.integers import reference, sampling
from palpate.model_export.integers.bounds import told_as_ours
from palpate.model_export.schema import FirstStage, ModelSpec, Term

Q24 = 1 << 24
LN_MILLION = math.log(1e6)
TRIED = 2000  # vectors of the domain on which the words' precision is chosen
NO_LIMIT = 1 << 29
LN = 1
OWN_UNIT = 7.9
"""An output with an identity link that stays within it is told in its own unit."""
ROOM_OF_A_ROW = 30.0
MARGIN_ONE = 256  # the domain's margin of one half-width


def feature_ids(names: tuple[str, ...] | list[str], first: FirstStage | None = None) -> list[int]:
    """Index of each name in the firmware's feature list, behind which a first stage's estimates stand.

    ModelError names the one it does not know.
    """
    known = list(feature_names.NAMES)
    if first is not None:
        known += [estimate.name for estimate in first.estimates]
    for name in names:
        if name not in known:
            raise ModelError(f"the firmware computes no feature called {name!r}; it knows {', '.join(known)}")
    return [known.index(name) for name in names]


@told_as_ours()
def compile_model(spec: ModelSpec) -> ev.Tables:
    """Integer tables of a validated model.

    Raises
    ------
    ModelError
        If a feature is unknown to the firmware, or the domain's precision is not positive definite.
    ProofError
        If a coefficient or an intercept does not fit its word.
    """
    spec.validate()
    if spec.features_version > firmware_features.FEATURES_VERSION:
        raise ModelError(
            f"the model was trained on version {spec.features_version} of the features, "
            f"the firmware computes version {firmware_features.FEATURES_VERSION}; fit it again"
        )
    ids = feature_ids(spec.features, spec.first)
    feats, radius = _features(spec)
    steps = nested.program(spec.terms)
    gain = radius / np.array(spec.scale)
    scales = _scales(spec, gain)
    units = np.array([_unit(link) for link in scales])
    outs, y_radius, y_mid = _outputs(spec, scales)
    rows = [
        _row(
            o.name,
            spec.terms,
            np.array(o.coefficients) / unit,
            LN_MILLION if link == LN else 0.0,
            steps,
            gain,
        )
        for o, link, unit in zip(spec.outputs, scales, units)
    ]
    floors = [0.0 if o.link == "ln" else (o.hi - o.lo) / 10 / unit for o, unit in zip(spec.outputs, units)]
    distance = _distance_rows(spec, gain)
    features = _some_features(spec)
    z = reference.standardised(spec, features)
    form, summed = quantise.choose(rows, quantise.Inputs(z / gain, steps), floors)
    said = reference.evaluate(spec, features)
    y = (said["y"] - y_mid) / y_radius
    widths = said["sigma"] * np.array(spec.interval.quantiles).max(axis=1) / units
    sigma, runs, down = quantise.choose_few(
        _sigma_rows(spec, gain, y_radius, y_mid), form, np.c_[y, z / gain], widths
    )
    coarse = [words.coarse(row, form.high) for row in distance]
    c, d, own, head = _sums(form, summed, len(ids))
    c.extend(np.array([w.high for w in sigma]).T.ravel().tolist())
    d.extend(np.array([w.low for w in sigma]).T.ravel().tolist())
    for row in coarse:
        c.extend(row.high.tolist())
    limits = array("i")
    for ident, limit in zip(feature_ids([r.feature for r in spec.lump]), spec.lump):
        lo = -NO_LIMIT if limit.lo is None else to_word(limit.lo * Q24, limit.feature)
        hi = NO_LIMIT if limit.hi is None else to_word(limit.hi * Q24, limit.feature)
        limits.extend((ident, lo, hi))
    head[ev.DOWNS] += down << 4 * len(form.downs)
    head[ev.N_LIMITS] = len(spec.lump)
    head[ev.HARD_BELOW] = to_word(spec.hard_below * 1e6, "hard_below")
    head[ev.FORCE_LO] = to_word(spec.force_range[0] * 1e6, "force_range")
    head[ev.FORCE_HI] = to_word(spec.force_range[1] * 1e6, "force_range")
    head[ev.LINKS] = sum(1 << j for j, link in enumerate(scales) if link == LN)
    head[ev.LEVEL_PERMILLE] = round(spec.interval.level * 1000)
    head[ev.MARGIN] = round(spec.domain.margin * MARGIN_ONE)
    return ev.Tables(
        bytes(ids),
        feats,
        nested.to_bytes((*form.steps, *runs)),
        c,
        d,
        own,
        _heads(*summed, *sigma, *coarse),
        outs,
        limits,
        head,
    )


@told_as_ours()
def compile_first(first: FirstStage) -> stage.Stage:
    """Integer arrays of a model's first stage; the same errors as `compile_model`."""
    taken = {e.name for e in first.estimates} & set(feature_names.NAMES)
    if taken:
        raise ModelError(
            f"the firmware has a feature called {min(taken)!r}: the first stage's is to be another"
        )
    return compile_stage(first, feature_ids(first.features), firmware_features.COUNT)


@told_as_ours()
def compile_checks(spec: ModelSpec) -> stage.Stage | None:
    """Integer arrays of a model's checks, if it has any; the same errors as `compile_model`."""
    if spec.checks is None:
        return None
    ids = feature_ids(spec.checks.features, spec.first)
    before = 0 if spec.first is None else len(spec.first.estimates)
    return compile_stage(spec.checks, ids, firmware_features.COUNT + before)


def compile_stage(first: FirstStage, ids: list[int], feature_count: int) -> stage.Stage:
    """As `compile_first`, of features that stand at `ids` among `feature_count`."""
    feats, radius = _features(first)
    steps = nested.program(first.terms)
    gain = radius / np.array(first.scale)
    ends = array("i", [0] * (stage.ENDS * stage.MOST))
    rows = []
    for j, estimate in enumerate(first.estimates):
        ends[2 * j], ends[2 * j + 1] = math.ceil(estimate.lo * Q24), math.floor(estimate.hi * Q24)
        rows.append(_row(estimate.name, first.terms, np.array(estimate.coefficients), 0.0, steps, gain))
    # about the centre, as far as the clip box goes: what the press of any tissue gives
    random = np.random.default_rng(1)
    spread = np.clip(random.normal(0, 1.2, (TRIED, len(ids))), *_standard_clip(first))
    form, summed = quantise.choose(rows, quantise.Inputs(spread / gain, steps), [0.0] * len(rows))
    c, d, own, head = _sums(form, summed, len(ids))
    return stage.Stage(
        bytes(ids),
        feats,
        nested.to_bytes(form.steps),
        c,
        d,
        own,
        _heads(*summed),
        ends,
        head,
        len(rows),
        feature_count,
        _joining(first),
        sum(of << j for j, of in enumerate(reference.of_press(first))),
    )


def _sums(
    form: Form, rows: list[Words], features: int
) -> tuple[array[int], array[int], array[int], array[int]]:
    """The polynomials' words, c, d and own, and the evaluator's head as far as it is of them."""
    c, d, own = array("h"), array("h"), array("i")
    at = 0
    for step in form.steps:
        for _ in step.terms:
            if isinstance(step, nested.Run):
                c.extend(int(w.high[at]) for w in rows)
                d.extend(int(w.low[at]) for w in rows)
            else:
                own.extend(form.own(j, w, at) for j, w in enumerate(rows))
            at += 1
    head = array("i", [0] * ev.HEAD)
    head[ev.N_FEATURES] = features
    head[ev.LEAVES] = len(c) // len(rows)
    head[ev.LOW_BITS] = form.low
    head[ev.PART_BITS] = form.part
    head[ev.HIGH_BITS] = form.high
    head[ev.STEPS] = len(nested.to_bytes(form.steps))
    head[ev.DOWNS] = sum(down << 4 * j for j, down in enumerate(form.downs))
    head[ev.SUMS] = len(rows)
    return c, d, own, head


def _heads(*rows: Words) -> array[int]:
    """Intercepts and shifts."""
    return array("i", [v for row in rows for v in (row.intercept, row.shift)])


def _joining(first: FirstStage) -> array[int]:
    """How a reference joins, as `firmware_py.stage` has it."""
    if first.joining is None:
        return array("i")
    weights, rows, limit = first.joining.weights, first.joining.triangle, first.joining.limit
    steep = [v for row in rows for v in row]
    return array("i", [
        *(round(w * 2**14) for w in weights), *(round(v * 2**6) for v in steep), round(limit * 2**20)
    ])  # fmt: skip


def _standard_clip(first: FirstStage) -> tuple[np.ndarray, np.ndarray]:
    """The clip box of the first stage's features, standardised."""
    lo, hi = ((np.array(v) - first.centre) / first.scale for v in (first.clip_lo, first.clip_hi))
    return lo, hi


def _some_features(spec: ModelSpec) -> np.ndarray:
    """Some vectors of the domain."""
    try:
        return sampling.in_domain(spec, TRIED)
    except ModelError:  # nothing lies in it: any vectors will do
        return np.array([spec.centre] * 2)


def _features(spec: ModelSpec | FirstStage) -> tuple[array[int], np.ndarray]:
    """Feature table, and for each feature how much of its unit makes u = 1."""
    table = array("i")
    radius = []
    for i in range(len(spec.features)):
        lo, hi = math.floor(spec.clip_lo[i] * Q24), math.ceil(spec.clip_hi[i] * Q24)
        lo, hi = max(lo, 1 - NO_LIMIT), min(hi, NO_LIMIT - 1)
        centre = round(spec.centre[i] * Q24)
        shift, factor = unpack.scaling(lo, hi, centre)
        box = (lo, hi)
        if isinstance(spec, ModelSpec):
            box = (math.floor(spec.domain.lo[i] * Q24), math.ceil(spec.domain.hi[i] * Q24))
        table.extend((lo, hi, centre, shift, factor, *box))
        radius.append(2.0**42 / factor * 2.0**shift / Q24)
    return table, np.array(radius)


def _unit(link: int) -> float:
    """What 1 on the evaluator's link scale is on the model's."""
    return 1.0 if link <= LN else 2.0 ** (2 + 24 - link) * 1e-6


def _scales(spec: ModelSpec, gain: np.ndarray) -> list[int]:
    """Each output's link as the evaluator has it (`scales.value`)."""
    found = []
    for output in spec.outputs:
        if output.link == "ln":
            found.append(LN)
            continue
        most = max(abs(output.lo), abs(output.hi))
        if most > OWN_UNIT:  # a unit in which sums, too, have room
            sizes = [abs(c) * _gain(t, gain) for t, c in zip(spec.terms, output.coefficients)]
            places = math.ceil(math.log2(max(most, sum(sizes)) / ROOM_OF_A_ROW / 1e-6))
            found.append(2 + 24 - min(places, 24))
        else:
            found.append(0)
    return found


def _outputs(spec: ModelSpec, scales: list[int]) -> tuple[array[int], np.ndarray, np.ndarray]:
    """Output table; radius and middle of each clipped prediction on the spec's own link scale."""
    table = array("i")
    radius, middle = [], []
    parts = zip(spec.outputs, spec.interval.quantiles, spec.domain.ranges, scales)
    for output, quantiles, ends, link in parts:
        is_ln, unit = link == LN, _unit(link)
        offset = LN_MILLION if is_ln else 0.0
        lo, hi = ((math.log(v) if is_ln else v / unit) + offset for v in (output.lo, output.hi))
        y_lo, y_hi = math.ceil(lo * Q24), math.floor(hi * Q24)
        mid, shift = unpack.middle(y_lo, y_hi)
        ln_q = [ev.NO_WIDTH if q <= 1e-6 else round(math.log(q / unit) * Q24) for q in quantiles]
        if max(ln_q) >= 1 << 28:
            raise ModelError(
                f"the interval's quantile of {output.name} is too large for the firmware's integers"
            )
        # where a range has no end, the prediction's own limit serves: nothing lies beyond it
        bound = [edge if e is None else round(((math.log(e) if is_ln else e / unit) + offset) * Q24)
                 for e, edge in zip(ends, (y_lo, y_hi))]  # fmt: skip
        table.extend((link, y_lo, y_hi, mid, shift, *ln_q, max(bound[0], y_lo), min(bound[1], y_hi)))
        radius.append(2.0 ** (28 + shift) / Q24 * unit)
        middle.append((mid / Q24 - offset) * unit)
    return table, np.array(radius), np.array(middle)


def _gain(term: Term, gain: np.ndarray) -> float:
    return float(np.prod([gain[i] for i in term]))


def _row(
    name: str,
    terms: Sequence[Term],
    coefficients: np.ndarray,
    intercept: float,
    steps: list[nested.Step],
    gain: np.ndarray,
) -> Row:
    """A polynomial over standardised features as a row over u."""
    index = {t: k for k, t in enumerate(nested.order(steps))}
    row = Row(np.zeros(len(index)), intercept, 24, name)
    for term, value in zip(terms, coefficients.tolist()):
        if term:
            row.coefficients[index[term]] = value * _gain(term, gain)
        else:
            row.intercept += value
    return row


def _sigma_rows(spec: ModelSpec, gain: np.ndarray, y_radius: np.ndarray, y_mid: np.ndarray) -> list[Row]:
    rows = []
    n_terms = len(spec.interval.terms)
    for output, values in zip(spec.outputs, spec.interval.coefficients):
        on_y = np.array(values[n_terms:])
        row = Row(np.zeros(ev.OUTPUTS + len(gain)), float(on_y @ y_mid), 24, f"ln sigma of {output.name}")
        row.coefficients[: ev.OUTPUTS] = on_y * y_radius
        for term, value in zip(spec.interval.terms, values):
            if term:
                row.coefficients[ev.OUTPUTS + term[0]] = value * gain[term[0]]
            else:
                row.intercept += value
        rows.append(row)
    return rows


def _distance_rows(spec: ModelSpec, gain: np.ndarray) -> list[Row]:
    """Rows m, lower triangular: |m (z - centre)|^2 = (z - centre)' precision (z - centre) / threshold."""
    precision = np.array(spec.domain.precision)
    try:
        lower = np.linalg.cholesky(precision[::-1, ::-1])
    except np.linalg.LinAlgError:
        raise ModelError("domain.precision is not positive definite") from None
    m = lower.T[::-1, ::-1] / math.sqrt(spec.domain.threshold)
    offset = -m @ np.array(spec.domain.centre)
    return [
        Row((m[i] * gain)[: i + 1], float(offset[i]), 12, f"coordinate {i} of the domain")
        for i in range(len(gain))
    ]

"""ModelSpec to the integer tables of `firmware_py.evaluator`.

Features become u in +-1 over the clip box, so that every monomial stays in +-1 (Q28); coefficients
are rescaled accordingly and split into a 16-bit high and an 8- or 16-bit low word, with one power of two
a row, as large as its sum allows.
"""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass

import numpy as np

from firmware_py import evaluator as ev
from firmware_py import features as firmware_features
from model_export.errors import ModelError, ProofError
from model_export.schema import ModelSpec, Term

Q24 = 1 << 24
LN_MILLION = math.log(1e6)
FEW_LOW_BITS = 8  # low words of one byte, where sums are small enough to be finer than Q24 with them
MANY_LOW_BITS = (10, 9)  # more would be beyond what the sums can hold, and the image is to stay below 8000 bytes
NO_LIMIT = 1 << 29
MARGIN_ONE = 256  # the domain's margin of one half-width


def feature_ids(names: tuple[str, ...] | list[str]) -> list[int]:
    """Index of each name in the firmware's feature list; ModelError names the one it does not know."""
    known = list(firmware_features.NAMES)
    for name in names:
        if name not in known:
            raise ModelError(f"the firmware computes no feature called {name!r}; it knows {', '.join(known)}")
    return [known.index(name) for name in names]


def term_order(spec: ModelSpec) -> tuple[list[Term], int]:
    """Terms as evaluated (without the constant), and how many leading ones ln sigma needs.

    Features come first, then products in an order in which each has its parent before it; parents that no
    sum uses are added.
    """
    sigma = _closed(spec.interval.terms)
    products = sigma | _closed(spec.terms)
    order: list[Term] = [(i,) for i in range(len(spec.features))]
    order += sorted((t for t in products if len(t) > 1), key=lambda t: (t not in sigma, len(t), t))
    if not any(t for t in spec.interval.terms):
        return order, 0
    return order, len(spec.features) + sum(len(t) > 1 for t in sigma)


def _closed(terms: tuple[Term, ...]) -> set[Term]:
    out: set[Term] = set()
    for term in terms:
        while term:
            out.add(term)
            term = term[:-1]
    return out


@dataclass
class Row:
    """One sum: coefficients over its inputs (each within +-1), intercept, fraction bits of the result.

    `most` is the largest high word.
    """

    coefficients: np.ndarray
    intercept: float
    fraction: int
    name: str
    most: int = 32000


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
    if spec.features_version != firmware_features.FEATURES_VERSION:
        raise ModelError(
            f"the model was trained on version {spec.features_version} of the features, "
            f"the firmware computes version {firmware_features.FEATURES_VERSION}; fit it again"
        )
    ids = feature_ids(spec.features)
    feats, radius = _features(spec)
    order, n_sigma = term_order(spec)
    index = {t: k for k, t in enumerate(order)}
    steps = bytearray()
    for term in order[len(ids) :]:
        parent = index[term[:-1]]
        if parent > 255:
            raise ModelError("the model has too many products: a parent's index does not fit a byte")
        steps += bytes((parent, term[-1]))
    outs, y_radius, y_mid = _outputs(spec)
    gain = radius / np.array(spec.scale)
    rows = _output_rows(spec, index, gain)
    rows += _sigma_rows(spec, index, n_sigma, gain, y_radius, y_mid)
    rows += _distance_rows(spec, gain)
    bits = low_bits(rows)
    c, d, heads = array("h"), array("b" if bits == FEW_LOW_BITS else "h"), array("i")
    words = [quantise(row, bits) for row in rows]
    for k, (high, low, _, _) in enumerate(words):
        c.extend(high)
        if k < 2 * ev.OUTPUTS:  # the distance does without
            d.extend(low)
    for _, _, intercept, shift in words:
        heads.extend((intercept, shift))
    limits = array("i")
    for ident, limit in zip(feature_ids([r.feature for r in spec.lump]), spec.lump):
        lo = -NO_LIMIT if limit.lo is None else _word(limit.lo * Q24, limit.feature)
        hi = NO_LIMIT if limit.hi is None else _word(limit.hi * Q24, limit.feature)
        limits.extend((ident, lo, hi))
    head = array("i", [0] * ev.HEAD)
    head[ev.N_FEATURES] = len(ids)
    head[ev.N_TERMS] = len(order)
    head[ev.N_SIGMA] = n_sigma
    head[ev.LOW_BITS] = bits
    head[ev.N_LIMITS] = len(spec.lump)
    head[ev.HARD_BELOW] = _word(spec.hard_below * 1e6, "hard_below")
    head[ev.FORCE_LO] = _word(spec.force_range[0] * 1e6, "force_range")
    head[ev.FORCE_HI] = _word(spec.force_range[1] * 1e6, "force_range")
    head[ev.LINKS] = sum(1 << j for j, output in enumerate(spec.outputs) if output.link == "ln")
    head[ev.LEVEL_PERMILLE] = round(spec.interval.level * 1000)
    head[ev.MARGIN] = round(spec.domain.margin * MARGIN_ONE)
    return ev.Tables(bytes(ids), feats, bytes(steps), c, d, heads, outs, limits, head)


def _word(value: float, name: str) -> int:
    number = round(value)
    if abs(number) >= 1 << 30:
        raise ProofError(f"{name} does not fit the firmware's integers: {value:g} is beyond 2^30")
    return number


def _features(spec: ModelSpec) -> tuple[array[int], np.ndarray]:
    """Feature table, and for each feature how much of its unit makes u = 1."""
    table = array("i")
    radius = []
    for i in range(len(spec.features)):
        lo, hi = math.floor(spec.clip_lo[i] * Q24), math.ceil(spec.clip_hi[i] * Q24)
        lo, hi = max(lo, 1 - NO_LIMIT), min(hi, NO_LIMIT - 1)
        centre = round(spec.centre[i] * Q24)
        shift, factor = ev.scaling(lo, hi, centre)
        box = (math.floor(spec.domain.lo[i] * Q24), math.ceil(spec.domain.hi[i] * Q24))
        table.extend((lo, hi, centre, shift, factor, *box))
        radius.append(2.0**56 / factor * 2.0**shift / Q24)
    return table, np.array(radius)


def _outputs(spec: ModelSpec) -> tuple[array[int], np.ndarray, np.ndarray]:
    """Output table; radius and middle of each clipped prediction on the spec's own link scale."""
    table = array("i")
    radius, middle = [], []
    for output, quantiles, ends in zip(spec.outputs, spec.interval.quantiles, spec.domain.ranges):
        is_ln = output.link == "ln"
        offset = LN_MILLION if is_ln else 0.0
        lo, hi = ((math.log(v) if is_ln else v) + offset for v in (output.lo, output.hi))
        y_lo, y_hi = math.ceil(lo * Q24), math.floor(hi * Q24)
        mid, shift = ev.middle(y_lo, y_hi)
        ln_q = [ev.NO_WIDTH if q <= 1e-6 else round(math.log(q) * Q24) for q in quantiles]
        if max(ln_q) >= 1 << 28:
            raise ModelError(f"the interval's quantile of {output.name} is absurdly large")
        # where a range has no end the prediction's own will do: nothing lies beyond it
        bound = [edge if e is None else round(((math.log(e) if is_ln else e) + offset) * Q24)
                 for e, edge in zip(ends, (y_lo, y_hi))]  # fmt: skip
        table.extend((int(is_ln), y_lo, y_hi, mid, shift, *ln_q, max(bound[0], y_lo), min(bound[1], y_hi)))
        radius.append(2.0 ** (28 + shift) / Q24)
        middle.append(mid / Q24 - offset)
    return table, np.array(radius), np.array(middle)


def _gain(term: Term, gain: np.ndarray) -> float:
    return float(np.prod([gain[i] for i in term]))


def _output_rows(spec: ModelSpec, index: dict[Term, int], gain: np.ndarray) -> list[Row]:
    rows = []
    for output in spec.outputs:
        row = Row(np.zeros(len(index)), LN_MILLION if output.link == "ln" else 0.0, 24, output.name)
        for term, value in zip(spec.terms, output.coefficients):
            if term:
                row.coefficients[index[term]] = value * _gain(term, gain)
            else:
                row.intercept += value
        rows.append(row)
    return rows


def _sigma_rows(
    spec: ModelSpec,
    index: dict[Term, int],
    n_sigma: int,
    gain: np.ndarray,
    y_radius: np.ndarray,
    y_mid: np.ndarray,
) -> list[Row]:
    rows = []
    n_terms = len(spec.interval.terms)
    for output, values in zip(spec.outputs, spec.interval.coefficients):
        on_y = np.array(values[n_terms:])
        row = Row(np.zeros(5 + n_sigma), float(on_y @ y_mid), 24, f"ln sigma of {output.name}")
        row.coefficients[:5] = on_y * y_radius
        for term, value in zip(spec.interval.terms, values):
            if term:
                row.coefficients[5 + index[term]] = value * _gain(term, gain)
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
        Row((m[i] * gain)[: i + 1], float(offset[i]), 12, f"coordinate {i} of the domain", 2000)
        for i in range(len(gain))
    ]


def low_bits(rows: list[Row]) -> int:
    """How many low bits this model's coefficients and inputs need, and their sums have room for."""
    if all(fraction_bits(row) + 13 >= 24 for row in rows[: ev.OUTPUTS]):
        return FEW_LOW_BITS
    for bits in MANY_LOW_BITS:
        words = [quantise(row, bits)[:2] for row in rows]
        sums = [sum(abs(h) << bits for h in high) + sum(abs(v) * 8200 for v in low) for high, low in words]
        if max(sums) < 1.06e9:
            return bits
    return FEW_LOW_BITS


def fraction_bits(row: Row) -> int:
    """Fraction bits of a row's high words: as many as its sum has room for."""
    values = np.abs(row.coefficients)
    for fraction in range(20, -12, -1):
        # |high part of an input| <= 2^13, of a coefficient < 2^15; half a bit of room for the low parts
        size = 2.0**fraction
        if (
            np.max(values, initial=0.0) * size <= row.most
            and (values.sum() * size + len(values)) * 8200 < 1.06e9
        ):
            return fraction
    raise ProofError(f"the coefficients of {row.name} are too large for the firmware's integers")


def quantise(row: Row, bits: int) -> tuple[list[int], list[int], int, int]:
    """High and low words, intercept and shift of a row, at the finest power of two that cannot overflow."""
    fraction = fraction_bits(row)
    whole = [round(float(v) * 2.0 ** (fraction + bits)) for v in row.coefficients]
    high = [(w + (1 << bits - 1)) >> bits for w in whole]
    low = [w - (h << bits) for w, h in zip(whole, high)]
    intercept = _word(row.intercept * 2.0**row.fraction, f"the intercept of {row.name}")
    return high, low, intercept, fraction + 13 - row.fraction

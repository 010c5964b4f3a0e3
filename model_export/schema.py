"""A fitted model in float64: what `palpate fit` writes as model.json and `palpate export` compiles.

Units: features as the firmware names them, outputs as `OUTPUTS` says. In the words of the formulas below,

    x  = min(max(feature, clip_lo), clip_hi)          z = (x - centre) / scale
    y_j = sum_k coefficients[j][k] * prod_{i in terms[k]} z_i         (the link scale: ln or identity)
    y_j is then clipped to [lo_j, hi_j]; value_j = exp(y_j) or y_j
    ln sigma_j = sum_k sigma[j][k] * prod_{i in sigma_terms[k]} z_i + sum_m sigma[j][K + m] * y_m
    low_j, high_j = link^-1(y_j -+ quantile[j][class] * sigma_j), clipped to [lo_j, hi_j]

with class 1 where the predicted E_inv23 is below the hardness threshold (a hard lump), 0 otherwise.
"""

from __future__ import annotations

import json
import os
import tempfile
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

from model_export import check
from model_export.errors import ModelError
from model_export.vocabulary import KINDS, LINKS, OUTPUTS, Term

__all__ = ["KINDS", "LINKS", "OUTPUTS", "Domain", "Interval", "Limit", "ModelSpec", "Output", "Term"]

FORMAT = "palpate-model"
VERSION = 2


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
    """Where the model may be believed: a box in feature units, a distance, ranges of the estimates.

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
class ModelSpec:
    """A whole fitted model; `validate` says in one sentence what is wrong with it.

    Attributes
    ----------
    kind : str
        "thesis" or "field".
    probe : str
        Identity of the probe: `firmware_py.image.PROBE`, at most 16 ASCII characters.
    features_version : int
        `firmware_py.features.FEATURES_VERSION` of the features that the model was trained on.
    features : tuple of str
        Names out of `firmware_py.features.NAMES`.
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
        Opaque here: `model_export.force_map` turns it into the firmware's table.
    training : dict
        At least "hash" (64 hex digits) and "n"; noise level, seed and scores are welcome.
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

    def validate(self) -> ModelSpec:
        """Check everything that can be checked without the firmware; return self, or raise ModelError."""
        check.spec(self)
        return self

    def to_dict(self) -> dict[str, Any]:
        """Plain dict as written to model.json."""
        return {"format": FORMAT, "version": VERSION, **asdict(self)}

    @staticmethod
    def from_dict(data: Any) -> ModelSpec:
        """Model of a parsed model.json; raises ModelError."""
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            raise ModelError('this is not a Palpate model: it has no "format": "palpate-model"')
        if data.get("version") != VERSION:
            raise ModelError(
                f"model.json has version {data.get('version')!r}, this program reads version {VERSION}"
            )
        body = {k: v for k, v in data.items() if k not in ("format", "version")}
        return _build(ModelSpec, body, "the model").validate()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Validate and write model.json; the old file stays whole until the new one is on disk."""
        self.validate()
        try:
            text = json.dumps(self.to_dict(), indent=1, allow_nan=False, sort_keys=True)
        except (ValueError, TypeError) as error:
            raise ModelError(f"the model cannot be written as JSON: {error}") from None
        path = Path(path)
        handle, name = tempfile.mkstemp(prefix=path.name, dir=path.parent)
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as out:
                out.write(text + "\n")
                out.flush()
                os.fsync(out.fileno())
            os.replace(name, path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise

    @staticmethod
    def load(path: str | os.PathLike[str]) -> ModelSpec:
        """Read and validate model.json; raises ModelError with one clear sentence."""
        try:
            text = Path(path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ModelError(f"cannot read the model {path}: {error}") from None
        try:
            data = json.loads(text, parse_constant=_no_constant)
        except ValueError as error:
            raise ModelError(f"{path} is not a readable model.json: {error}") from None
        return ModelSpec.from_dict(data)


def _no_constant(word: str) -> float:
    raise ValueError(f"it holds {word}, which is not a number")


_PARTS: dict[str, Any] = {"outputs": Output, "interval": Interval, "domain": Domain, "lump": Limit}


def _build(cls: Any, data: Any, where: str) -> Any:
    """Dataclass of a dict of JSON: unknown and missing keys are named, lists become tuples."""
    if not isinstance(data, dict):
        raise ModelError(f"{where} must be an object")
    known = {f.name for f in fields(cls)}
    optional = {"force_map", "notes"} | ({"lo", "hi"} if cls is Limit else set())
    for key in data:
        if key not in known:
            raise ModelError(f"{where} has the unknown entry {key!r}")
    for key in known - optional:
        if key not in data:
            raise ModelError(f"{where} lacks {key!r}")
    values: dict[str, Any] = {}
    for key, value in data.items():
        part = _PARTS.get(key)
        if cls is ModelSpec and part is not None and is_dataclass(part):
            many = key in ("outputs", "lump")
            if many and not isinstance(value, list | tuple):
                raise ModelError(f"{key} must be a list")
            values[key] = (
                tuple(_build(part, item, f"{key}[{i}]") for i, item in enumerate(value))
                if many
                else _build(part, value, key)
            )
        else:
            values[key] = value if isinstance(value, dict) else _tuples(value)
    return cls(**values)


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list | tuple) else value

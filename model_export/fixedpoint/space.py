"""A model before it is compiled: features, functions of them, and polynomials of both, in float64.

What a polynomial is made of is an *atom*: a feature, or a function of one. An atom's value is centre +
radius * z with z within +-1 over the feature's box; polynomials are kept in the z of their atoms, where
their coefficients say how much a term matters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from firmware_py import unpack
from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.nested import Term

LARGEST = 1 << 29
"""No feature's integer is beyond it."""
FEWEST = 8
"""Steps of a box, where values are no integers."""
NEGLIGIBLE = 1e-7
"""Of a feature's radius: what its centre may be off."""
FINE = 3e7
"""Steps of a feature over its box, at least, where its values are no integers."""

Array = np.ndarray


@dataclass(frozen=True)
class Feature:
    """A number that goes into the program, as an integer of `step`s.

    Attributes
    ----------
    name : str
    step : float
        What an integer of 1 stands for.
    lo, hi : int
        Its box, in steps; what is beyond is held at its ends.
    exact : bool
        Its values are whole numbers of steps; else they are rounded to such.
    """

    name: str
    step: float
    lo: int
    hi: int
    exact: bool = False

    @staticmethod
    def over(name: str, lo: float, hi: float, whole: bool = False, step: float | None = None) -> Feature:
        """A feature over [lo, hi], in steps of a power of ten, or of 1 where its values are whole numbers."""
        if not (np.isfinite(lo) and np.isfinite(hi)):
            raise CompileError(f"the box of {name} must have finite ends, not {lo:g} and {hi:g}")
        if not lo < hi:
            raise CompileError(f"the box of {name} has no width: it goes from {lo:g} to {hi:g}; widen it")
        largest = max(abs(lo), abs(hi))
        if step is None:
            step = 1.0 if whole and largest < LARGEST else 10.0 ** np.floor(np.log10(largest / FINE))
            if not whole and hi - lo < 1000 * step:  # far from zero: as fine as integers can be
                step = 10.0 ** np.ceil(np.log10(largest / LARGEST) + 0.01)
        if not step > 0 or largest / step >= LARGEST:
            raise CompileError(
                f"{name} up to {largest:g} in steps of {step:g} does not fit the integers; take steps of "
                f"{10.0 ** np.ceil(np.log10(largest / LARGEST) + 0.01):g}"
            )
        ends = int(np.floor(lo / step + 1e-9)), int(np.ceil(hi / step - 1e-9))
        if ends[1] - ends[0] < (1 if whole else FEWEST):
            raise CompileError(
                f"the box of {name} is {hi - lo:.2g} wide, too little beside {largest:g} for steps of "
                f"{step:g}; take what it is above a constant as the feature"
            )
        return Feature(name, float(step), *ends, exact=whole and step == 1.0)

    def first_at(self, value: float) -> int:
        """The least integer of what is at least `value`: rounded alike, what is equal stays equal."""
        at = value / self.step
        return int(np.ceil(at - 1e-9)) if self.exact else round(at)

    def last_at(self, value: float) -> int:
        """The greatest integer of what is at most `value`."""
        at = value / self.step
        return int(np.floor(at + 1e-9)) if self.exact else round(at)

    def whole(self, values: Array) -> Array:
        """Values as the integers that the device is given, not yet held to the box."""
        return np.clip(np.round(values / self.step), -LARGEST, LARGEST).astype(np.int64)


@dataclass(frozen=True)
class Atom:
    """A feature (`function` is None), or a function of it, in float64, with the places where it has kinks."""

    feature: int
    of: Feature
    centre_step: int
    function: Callable[[Array], Array] | None = None
    kinks: tuple[float, ...] = ()
    name: str = ""

    @cached_property
    def scaling(self) -> tuple[int, int]:
        """The feature's shift and factor (`firmware_py.unpack.scaling`)."""
        shift, factor = unpack.scaling(self.of.lo, self.of.hi, self.centre_step)
        return int(shift), int(factor)

    @cached_property
    def _ends(self) -> tuple[float, float]:
        assert self.function is not None
        x = np.linspace(self.of.lo, self.of.hi, 4001) * self.of.step
        x = np.clip(np.append(x, self.kinks), self.of.lo * self.of.step, self.of.hi * self.of.step)
        y = np.asarray(self.function(x), float)
        if not np.isfinite(y).all():
            bad = x[~np.isfinite(y)][0]
            raise CompileError(f"{self.name} has no value at {self.of.name} = {bad:g}; narrow its box")
        return float(y.min()), float(y.max())

    @property
    def centre(self) -> float:
        """The value at z = 0."""
        return self.centre_step * self.of.step if self.function is None else sum(self._ends) / 2

    @property
    def radius(self) -> float:
        """How much the value changes from z = 0 to z = 1."""
        if self.function is None:
            shift, factor = self.scaling
            return 2.0**42 / factor * 2.0**shift * self.of.step
        lo, hi = self._ends
        return max((hi - lo) * 0.55, 1e-12 * max(abs(lo), abs(hi)), 1e-300)


Poly = dict[Term, float]
"""Term -> coefficient, over the z of atoms."""


@dataclass
class Space:
    """The features and atoms of one model."""

    features: Sequence[Feature]
    atoms: list[Atom] = field(default_factory=list)
    zeros: dict[int, float] = field(default_factory=dict)
    """What polynomials take for the centre of an atom, where `linear` passed over the difference."""
    _of_feature: dict[int, int] = field(default_factory=dict)

    def whole(self, X: Array) -> Array:
        """Features (n x features, in their units) as the integers that the device is given."""
        return np.stack([f.whole(X[:, i]) for i, f in enumerate(self.features)], axis=1)

    def random(self, rng: np.random.Generator, n: int) -> Array:
        """n vectors of the box, integers."""
        lo, hi = (np.array([getattr(f, end) for f in self.features]) for end in ("lo", "hi"))
        return rng.integers(lo, hi, (n, len(lo)), endpoint=True)

    def linear(self, feature: int, zero: float | None = None) -> Poly:
        """The feature itself; its atom's centre is `zero`, if that lies in its box, else the box's middle.

        Where the step is fine, what is between `zero` and the centre is passed over: it is less than a
        rounded feature is off, and every product would have terms of lower degree for it.
        """
        of = self.features[feature]
        if feature not in self._of_feature:
            centre = (of.lo + of.hi) // 2
            if zero is not None and of.lo <= round(zero / of.step) <= of.hi:
                centre = round(zero / of.step)
            self._of_feature[feature] = len(self.atoms)
            self.atoms.append(Atom(feature, of, centre, name=of.name))
        k = self._of_feature[feature]
        middle = self.atoms[k].centre
        if zero is not None and abs(zero - middle) <= NEGLIGIBLE * self.atoms[k].radius:
            middle = self.zeros[k] = zero
        return {(): middle, (k,): self.atoms[k].radius}

    def function(
        self, feature: int, f: Callable[[Array], Array], name: str, kinks: Iterable[float] = ()
    ) -> Poly:
        """A function of a feature, vectorised over its values."""
        of = self.features[feature]
        atom = Atom(feature, of, 0, f, tuple(float(k) for k in kinks), name)
        self.atoms.append(atom)
        return {(): atom.centre, (len(self.atoms) - 1,): atom.radius}


def plus(*parts: tuple[float, Poly]) -> Poly:
    """Sum of polynomials, each times a number."""
    out: Poly = {}
    for factor, poly in parts:
        if factor:
            for term, c in poly.items():
                out[term] = out.get(term, 0.0) + factor * c
    return out


def times(a: Poly, b: Poly) -> Poly:
    """Product."""
    out: Poly = {}
    for first, c in a.items():
        for second, d in b.items():
            term = tuple(sorted((*first, *second)))
            out[term] = out.get(term, 0.0) + c * d
    return out


def size(poly: Poly) -> float:
    """How far from its constant it can get."""
    return float(sum(abs(c) for term, c in poly.items() if term))


def without_dust(polys: list[Poly], sizes: Sequence[float]) -> list[Poly]:
    """Without the terms that matter to none of the polynomials, whose values vary by about these sizes."""
    kept = {t for p, s in zip(polys, sizes) for t, c in p.items() if t and abs(c) > 1e-9 * s}
    return [{t: c for t, c in p.items() if not t or t in kept} for p in polys]


def merged(space: Space, polys: list[Poly]) -> list[Poly]:
    """Functions of one feature that only stand for themselves, put together: one for each polynomial."""
    used = {k for p in polys for t in p if len(t) > 1 for k in t}
    by_feature: dict[int, list[int]] = {}
    for k in sorted({t[0] for p in polys for t in p if len(t) == 1}):
        if space.atoms[k].function is not None and k not in used:
            by_feature.setdefault(space.atoms[k].feature, []).append(k)
    out = [dict(p) for p in polys]
    for feature, atoms in by_feature.items():
        if len(atoms) < 2:
            continue
        kinks = sorted({x for k in atoms for x in space.atoms[k].kinks})
        for p in out:
            own = [(p.pop((k,)), space.atoms[k]) for k in atoms if (k,) in p]
            if own:
                f = _sum_of([(c / a.radius, a) for c, a in own])
                new = space.function(feature, f, f"a function of {space.features[feature].name}", kinks)
                for term, c in new.items():
                    p[term] = p.get(term, 0.0) + c
    return out


def _sum_of(parts: list[tuple[float, Atom]]) -> Callable[[Array], Array]:
    def f(x: Array) -> Array:
        total = np.zeros(len(x))
        for c, atom in parts:
            assert atom.function is not None
            total += c * (atom.function(x) - atom.centre)
        return total

    return f

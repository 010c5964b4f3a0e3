"""From polynomials, or other sums, to a program: scales, outputs, intervals, a domain, a verdict."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from palpate.fixedpoint import ir, space, word_pairs
from palpate.fixedpoint.calibration import Calibration
from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.ir import Code, Node, var
from palpate.fixedpoint.kernels import Kernels, KernelSums
from palpate.fixedpoint.polynomials import Polynomials, Scale
from palpate.fixedpoint.program import Output, Program, assemble
from palpate.fixedpoint.space import Array, Poly, Space
from palpate.fixedpoint.word_pairs import Row

TRIED = 1000  # vectors of the data, and of the box, on which words are chosen
FINEST = 2e-6  # of a standard deviation: an output's step
COARSEST = 1e-3  # the same, at most
LARGEST = 1e100
"""Of an output: the squares of what is larger would be beyond float64."""
WIDEST = 1 << 29
"""Of half an interval, as an integer."""


@dataclass
class Model:
    """A regression in float64, read from whatever it was.

    Attributes
    ----------
    space : Space
    polys : list of Poly
        One an output, on the link scale.
    names, units, links : list of str
    reference : callable
        Features (n x features, in their units) -> what it gives in float64, n x outputs.
    forests : list of lists of trees, or None
        Trees whose leaves (in float64) are added to the polynomials.
    kernels : Kernels, or None
        Likewise.
    within : list of float
        The worst error that is wanted of each output, in its unit; 0, or none, for what is usual.
    precise : str
        "box" or "data": where errors are to be so small.
    classes : list
        Of a classifier, whose outputs are decisions: above 0 (one), or the largest (one a class).
    """

    space: Space
    polys: list[Poly]
    names: list[str]
    units: list[str]
    links: list[str]
    reference: Callable[[Array], Array]
    forests: list[list[Any]] | None = None
    kernels: Kernels | None = None
    within: Sequence[float] = ()
    precise: str = "box"
    classes: list[Any] = field(default_factory=list)


def build(model: Model, X: Array | None = None, calibration: Calibration | None = None) -> Program:
    """The program of a model.

    Parameters
    ----------
    X : array (n, features), optional
        Data that the model is for: words are chosen and errors told over them as over the box.
    calibration : Calibration, optional
        Adds each output's interval, and a flag that is 1 inside the domain.
    """
    _finite(model)
    features = model.space.features
    if X is None and model.precise == "data":
        raise CompileError('precise="data" wants data; give X')
    x = _vectors(model.space, X, model.precise)
    steps = np.array([f.step for f in features])
    everywhere = np.asarray(model.reference(x * steps), float)
    if not np.isfinite(everywhere).all():
        raise CompileError("the model has no finite value somewhere in its box; narrow the box")
    if np.abs(everywhere).max() > LARGEST:
        raise CompileError(
            f"the model reaches {np.abs(everywhere).max():.0e} over its box, beyond {LARGEST:.0e}; narrow "
            "the box, or scale the target"
        )
    told = everywhere[: TRIED if X is not None else None]
    # of a constant: what float64 makes of it
    spreads = [float(s) if s > 1e-9 * m else 0.0 for s, m in zip(told.std(axis=0), np.abs(told).max(axis=0))]
    sizes = [space.size(p) if link != "exp" else 1.0 for p, link in zip(model.polys, model.links)]
    polys = space.without_dust(model.polys, [s or z or 1.0 for s, z in zip(spreads, sizes)])
    told_polys, polys = polys, space.merged(model.space, polys)
    scales = []
    for k, (poly, name, link) in enumerate(zip(polys, model.names, model.links)):
        most = space.size(poly) + abs(poly.get((), 0.0))
        if link == "exp":  # far out in the box it is held at the largest integer
            most = min(float(np.abs(everywhere[:, k]).max()), 1e3 * float(np.abs(told[:, k]).max()))
        if model.forests is not None:
            most += sum(max(map(abs, _leaves(t))) for t in model.forests[k])
        if model.kernels is not None:
            most += float(np.abs(told[:, k]).max())
        spread = spreads[k] or most or 1.0
        step = 10.0 ** math.floor(math.log10(max(FINEST * spread, most / 2**29)))
        if most / step > 2**29:
            step *= 10
        if step > COARSEST * spread:
            raise CompileError(
                f"{name} reaches {most:.3g} and varies by {spread:.3g} only, too little for integers of 30 "
                "bits; take what it is above a constant as the target"
            )
        scales.append(Scale(name, step, spread, link, model.within[k] if model.within else 0.0))
    if model.classes:  # decisions are compared
        scales = [replace(s, step=max(s.step for s in scales)) for s in scales]
    code = Code()
    writer: Any
    if model.forests is not None:
        writer = _Forests(code, model, scales)
    elif model.kernels is not None:
        constants = [p.get((), 0.0) for p in polys]
        writer = KernelSums(code, model.space, model.kernels, constants, scales, x)
    else:
        writer = Polynomials(code, model.space, polys, scales, x)
    outputs = _outputs(code, writer, model, scales, calibration)
    if model.classes:
        _verdict(code, len(scales), len(outputs))
        outputs.append(Output("verdict", "", 1.0))
    return assemble(outputs, code, replace(model, polys=told_polys), X, calibration)


def _finite(model: Model) -> None:
    for k, (name, poly) in enumerate(zip(model.names, model.polys)):
        numbers = [*poly.values()]
        if model.forests is not None:
            numbers += [leaf for tree in model.forests[k] for leaf in _leaves(tree)]
        if model.kernels is not None:
            numbers += [*model.kernels.weights[k], *model.kernels.supports.ravel()]
        if not np.isfinite(numbers).all():
            raise CompileError(f"{name} has a coefficient that is not finite")


def _vectors(of: Space, X: Array | None, precise: str) -> Array:
    """Vectors over which words are chosen: of the data, if there are any, in the first half; int64."""
    rng = np.random.default_rng(1)
    box = of.random(rng, TRIED)
    if X is None:
        return box
    if precise == "data":
        return of.whole(X[np.resize(rng.permutation(len(X)), 2 * TRIED)])
    return np.vstack([of.whole(X[rng.integers(0, len(X), TRIED)]), box])


def _outputs(
    code: Code, writer: Any, model: Model, scales: Sequence[Scale], calibration: Calibration | None
) -> list[Output]:
    outputs: list[Output] = []
    for j, scale in enumerate(scales):
        t = writer.sums(j)
        code.let(
            f"out[{len(outputs)}]",
            writer.told(j, t),
            f"{scale.name} in {scale.step:g} {model.units[j]}".rstrip(),
        )
        outputs.append(Output(scale.name, model.units[j], scale.step))
        if calibration is not None:
            value = var(f"out[{len(outputs) - 1}]")
            unit = writer.link_unit(j)
            width = round(min(calibration.half_widths[j] / unit, 1 << 30))
            if width > WIDEST:
                raise CompileError(
                    f"calibrate's {scale.name} is {calibration.half_widths[j]:.2g} off, more than integers "
                    "can tell; is it the model's target?"
                )
            most = (1 << 30) - 1 - width
            for word, sign in (("low", -1), ("high", 1)):
                moved = ir.clip(t if scale.link == "exp" else value, -most, most) + sign * width
                end = writer.told(j, moved) if scale.link == "exp" else moved
                code.let(f"out[{len(outputs)}]", end, f"{scale.name}, {word}")
                outputs.append(Output(f"{scale.name}_{word}", model.units[j], scale.step))
    if calibration is not None:
        _domain(code, writer, model.space, calibration)
        code.let(f"out[{len(outputs)}]", var("f"))
        outputs.append(Output("inside", "", 1.0))
    return outputs


def _domain(code: Code, writer: Any, of: Space, calibration: Calibration) -> None:
    """f: 1 where the features are like those of the calibration, else 0."""
    code.let("f", 1, "inside: every feature between the ends that the calibration set had")
    for i, (feature, (lo, hi)) in enumerate(zip(of.features, calibration.ends)):
        ends = round(lo / feature.step), round(hi / feature.step)
        code.let("f", ir.pick(var(f"x[{i}]"), ends[0], 0, var("f")))
        code.let("f", ir.pick(ends[1], var(f"x[{i}]"), 0, var("f")))
    if not isinstance(writer, Polynomials):
        return
    atoms = [(i, of.atoms[k]) for i, k in enumerate(writer.atoms) if of.atoms[k].function is None]
    if not 2 <= len(atoms) <= 24:
        return
    rows = calibration.coordinates(atoms)
    for i, atom in atoms:
        code.let(f"d{i}", (var(f"u{i}") + 8192) >> 14, f"squared distance from the middle: {atom.name}")
    code.let("g", 0)
    for k, (coefficients, offset) in enumerate(rows):
        words = word_pairs.coarse(Row(coefficients, offset, 12, f"coordinate {k} of the domain"), 14)
        total: Node = ir.dot(words.high.tolist(), [f"d{i}" for i, _ in atoms[: k + 1]])
        code.let("h", (total >> words.shift) + words.intercept)
        code.let("h", ir.clip(var("h"), -16384, 16384))
        code.let("g", var("g") + (var("h") * var("h") >> 3))
    code.let("f", ir.pick(1 << 21, var("g"), 0, var("f")))


def _verdict(code: Code, decisions: int, at: int) -> None:
    note = "the class: of the largest decision, or whether the one is above 0"
    if decisions == 1:
        code.let(f"out[{at}]", ir.pick(0, var("out[0]"), 1, 0), note)
        return
    code.let("h", var("out[0]"), note)
    code.let("k", 0)
    for j in range(1, decisions):
        code.let("k", ir.pick(var("h"), var(f"out[{j}]"), j, var("k")))
        code.let("h", ir.pick(var("h"), var(f"out[{j}]"), var(f"out[{j}]"), var("h")))
    code.let(f"out[{at}]", var("k"))


def _leaves(of: Any) -> list[float]:
    return [v for v in ir.walk(of) if not isinstance(v, tuple)]


class _Forests:
    """Sums of trees: their leaves in steps, with as many binary places as there is room for."""

    def __init__(self, code: Code, model: Model, scales: Sequence[Scale]) -> None:
        assert model.forests is not None
        self.code, self.scales, self.first, self.places, self.constant = code, scales, [], [], []
        for poly, trees, scale in zip(model.polys, model.forests, scales):
            if any(t for t in poly):
                raise CompileError("a sum of trees and a polynomial cannot be compiled together")
            constant = poly.get((), 0.0)
            if scale.link == "exp":
                places, unit, constant = 24, 2.0**-24, constant - math.log(scale.step)
            else:
                most = sum(max(map(abs, _leaves(t))) for t in trees) / scale.step + len(trees) + 1
                places = max(min(math.floor(math.log2(2**29 / most)), 20), 0)
                unit = scale.step * 2.0**-places
            self.first.append(len(code.trees))
            code.trees += [_whole(t, unit) for t in trees]
            self.places.append(places)
            self.constant.append(
                round(constant / unit) if scale.link == "exp" else round(constant / scale.step)
            )

    def sums(self, j: int) -> Node:
        last = self.first[j + 1] if j + 1 < len(self.first) else len(self.code.trees)
        start = self.constant[j] if self.scales[j].link == "exp" else 0
        self.code.let("t", start, f"{self.scales[j].name}: sum of {last - self.first[j]} trees")
        for k in range(self.first[j], last):
            self.code.let("t", var("t") + ir.tree(k))
        return var("t")

    def link_unit(self, j: int) -> float:
        return 2.0**-24 if self.scales[j].link == "exp" else self.scales[j].step

    def told(self, j: int, t: Node) -> Node:
        if self.scales[j].link == "exp":
            return ir.exp(t, 24)
        half = 1 << self.places[j] - 1 if self.places[j] else 0
        return (t + half >> self.places[j]) + self.constant[j]


def _whole(of: Any, unit: float) -> Any:
    if isinstance(of, tuple):
        return (of[0], of[1], _whole(of[2], unit), _whole(of[3], unit))
    return round(of / unit)

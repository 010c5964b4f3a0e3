"""Polynomials of a space's atoms as statements: inputs, nested sums of words, what is left in `out`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.fixedpoint import ir, nested, pieces, quantise, sums
from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.form import Form
from palpate.fixedpoint.intervals import Interval
from palpate.fixedpoint.ir import Code, Node, var
from palpate.fixedpoint.space import Array, Poly, Space, size
from palpate.fixedpoint.word_pairs import Row, Words

MOST_TERMS = 4096
_WIDEST = 30.0  # units of a row: below the 64 that its Q24 has room for
_WIDEST_LN = 60.0  # the same of a logarithm, in which it has no more use for a finer unit
_MOST_UP = 4  # binary places that a logarithm may lose so
_REACHES = 41 << 23  # of a logarithm of steps: beyond it an integer has no room, or is nothing
_TOLERATED = 0.3  # of a standard deviation: what quantise's limits, 2.4e-5 at worst, are relative to


@dataclass(frozen=True)
class Scale:
    """How an output is told: an integer of 1 is `step`; its predictions vary by about `spread`.

    `link` is "identity", or "exp" for a polynomial of the logarithm of the output; `within` is the worst
    error that is wanted, in the output's unit, 0 for what is usual.
    """

    name: str
    step: float
    spread: float
    link: str = "identity"
    within: float = 0.0

    @property
    def tolerated(self) -> float:
        """What quantise's limits are relative to, in the output's unit."""
        return self.within / quantise.GOOD_WORST if self.within else _TOLERATED * self.spread


def not_too_many(terms: int) -> None:
    """CompileError where there are more terms than are compiled."""
    if terms > MOST_TERMS:
        raise CompileError(
            f"the model has {terms} terms, {MOST_TERMS} at most are compiled; select some of them "
            "(SelectKBest, Lasso) or take a lower degree"
        )


class Polynomials:
    """Statements for polynomials of the same atoms.

    Parameters
    ----------
    code : ir.Code
        To append to.
    space : Space
    polys : list of Poly
    scales : list of Scale
    x : array (n, features) of int64
        Vectors over which words are chosen.
    """

    def __init__(
        self, code: Code, space: Space, polys: Sequence[Poly], scales: Sequence[Scale], x: Array
    ) -> None:
        self.code, self.space, self.polys, self.scales = code, space, polys, scales
        terms = {t for p in polys for t in p if t}
        not_too_many(len(terms))
        self.atoms = sorted({k for t in terms for k in t})
        place = {k: i for i, k in enumerate(self.atoms)}
        self.steps = nested.program({tuple(sorted(place[k] for k in t)) for t in terms})
        self.index = {
            tuple(sorted(self.atoms[i] for i in t)): k for k, t in enumerate(nested.order(self.steps))
        }
        for i in range(len(self.atoms)):
            self._input(i)
        rows = [self._row(p, s) for p, s in zip(polys, scales)]
        self.rows = rows
        if self.steps:
            u = self.inputs(x)
            z = quantise.Inputs(u, self.steps)
            sizes = [self._sizes(r, s, z.terms) for r, s in zip(rows, scales)]
            self.form, self.words = quantise.choose(rows, z, sizes, any(s.within for s in scales))
        else:
            self.form = Form(20, 14, 14, (0,) * len(rows), ())
            none = np.zeros(0, np.int64)
            self.words = [Words(none, none, round(r.intercept * 2**24), 0, 0) for r in rows]
        self._keep_bits()
        names = [str(i) for i in range(len(self.atoms))]
        labels = [space.atoms[k].name for k in self.atoms]
        self.written = sums.Sums(code, self.form, self.words, names, labels, [s.name for s in scales])

    # ---- inputs

    def _input(self, i: int) -> None:
        """The atom as u: z in Q28."""
        atom, let = self.space.atoms[self.atoms[i]], self.code.let
        f, of = atom.feature, atom.of
        raw = let(
            "h", var(f"x[{f}]"), f"{atom.name}: z = (value - {atom.centre:.6g}) / {atom.radius:.6g}, Q28"
        )
        held = ir.clip(raw, of.lo, of.hi)
        if atom.function is not None:
            let("v", held)
            table = pieces.table(atom)
            self.code.tables.append(table)
            u = let(f"u{i}", ir.lookup(var("v"), len(self.code.tables) - 1))
            ends = table.over(Interval(of.lo, of.hi))
            if max(-ends.lo, ends.hi) > 1 << 28:  # the ranges of its cubics are wider than they are
                let(f"u{i}", ir.clip(u, -(1 << 28), 1 << 28))
            return
        sums.standardised(self.code, held, atom.centre_step, *atom.scaling, f"u{i}")

    def inputs(self, x: Array) -> Array:
        """The atoms' z as the device has them."""
        env = Code(self.code.lets, self.code.tables).columns(x)
        return np.stack([env[f"u{i}"] for i in range(len(self.atoms))], axis=1) / 2.0**28

    def _keep_bits(self) -> None:
        """Upper and lower halves of the inputs of branches, and of every input the bits that words meet."""
        branching = sums.branching(self.steps)
        for i in range(len(self.atoms)):
            u = var(f"u{i}")
            if i in branching:
                sums.keep_halves(self.code, u, str(i))
            sums.keep_bits(self.code, u, str(i), self.form)

    # ---- rows

    def _row(self, poly: Poly, scale: Scale) -> Row:
        """The polynomial in units in which it has room; identity: unit = step * 2^e."""
        constant = poly.get((), 0.0)
        row = Row(np.zeros(len(self.index)), 0.0, 24, scale.name)
        for term, c in poly.items():
            if term:
                row.coefficients[self.index[term]] += c
        if scale.link == "exp":
            unit = 2.0 ** self.exponent(poly, scale)
            row.coefficients /= unit
            row.intercept = (constant - math.log(scale.step)) / unit
            return row
        unit = scale.step * 2.0 ** self.exponent(poly, scale)
        row.coefficients /= unit
        row.intercept = (constant - self.offset(poly, scale) * scale.step) / unit
        return row

    def exponent(self, poly: Poly, scale: Scale) -> int:
        """e of the row's unit."""
        if scale.link == "exp":
            most = abs(poly.get((), 0.0) - math.log(scale.step)) + size(poly)
            if most > 2**_MOST_UP * _WIDEST_LN:
                raise CompileError(
                    f"{scale.name} may reach exp({most:.0f}) steps over the box; narrow the box"
                )
            return max(math.ceil(math.log2(most / _WIDEST_LN)), 0)
        return math.ceil(math.log2(max(size(poly) / _WIDEST, 0.02 * scale.spread) / scale.step))

    def offset(self, poly: Poly, scale: Scale) -> int:
        """Steps that are added at last."""
        return round(poly.get((), 0.0) / scale.step)

    def _sizes(self, row: Row, scale: Scale, terms: Array) -> Array:
        """What an error of the row is relative to, at each vector."""
        y = terms[:, :-1] @ row.coefficients + row.intercept
        k = self.scales.index(scale)
        if scale.link == "exp":
            unit = 2.0 ** self.exponent(self.polys[k], scale)
            steps = np.exp(np.clip(y * unit, -700, 700))
            return np.clip(scale.tolerated / (scale.step * steps), 0.01, 1.0) / unit
        unit = scale.step * 2.0 ** self.exponent(self.polys[k], scale)
        return np.full(len(y), scale.tolerated / unit)

    # ---- sums

    def sums(self, j: int) -> Node:
        """Statements of polynomial j: the row in Q24."""
        code, words = self.code, self.words[j]
        if not self.form.steps:
            return code.let("t", words.intercept)
        t = self.written.raw(j)
        return code.let("t", (t >> words.shift) + words.intercept, f"{self.scales[j].name}: sum")

    # ---- outputs

    def link_unit(self, j: int) -> float:
        """What 1 of `sums` is, in steps of the output or on the scale of its logarithm."""
        if self.scales[j].link == "exp":
            return 2.0 ** (self.exponent(self.polys[j], self.scales[j]) - 24)
        return self.scales[j].step

    def told(self, j: int, t: Node) -> Node:
        """Polynomial j, a row in Q24, as an integer of its steps."""
        scale = self.scales[j]
        if scale.link == "exp":
            up = self.exponent(self.polys[j], scale)
            if up:
                most = _REACHES >> up
                t = ir.clip(self.code.let("h", t), -most, most) << up
            return ir.exp(t, 24)
        down = 24 - self.exponent(self.polys[j], scale)
        half = (1 << down - 1) if down > 0 else 0
        return (t + half >> down if half else t >> down) + self.offset(self.polys[j], scale)

"""Polynomials of a space's atoms as statements: inputs, nested sums of words, what is left in `out`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.fixedpoint import ir, nested, pieces, quantise
from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.form import Form
from palpate.fixedpoint.intervals import Interval
from palpate.fixedpoint.ir import Code, Node, var
from palpate.fixedpoint.nested import Run, Term
from palpate.fixedpoint.space import Array, Poly, Space, size
from palpate.fixedpoint.word_pairs import Row, Words

MOST_TERMS = 4096
_DEPTHS = "tvwrs"
_WIDEST = 30.0  # units of a row: below the 64 that its Q24 has room for
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
        self.branching = {s.branch[-1] for s in self.steps if not isinstance(s, Run)}
        for i in range(len(self.atoms)):
            self._input(i)
        rows = [self._row(p, s) for p, s in zip(polys, scales)]
        self.rows = rows
        if self.steps:
            u = self.inputs(x)
            z = quantise.Inputs(u, self.steps)
            sizes = [self._sizes(r, s, z.terms) for r, s in zip(rows, scales)]
            self.form, self.words = quantise.choose(rows, z, sizes)
        else:
            self.form = Form(20, 14, 14, (0,) * len(rows), ())
            none = np.zeros(0, np.int64)
            self.words = [Words(none, none, round(r.intercept * 2**24), 0, 0) for r in rows]
        self._keep_bits()

    # ---- inputs

    def _name(self, i: int) -> str:
        return self.space.atoms[self.atoms[i]].name

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
        shift, factor = atom.scaling
        up = -shift
        v = let("v", held - atom.centre_step)
        if 0 <= up < 14 and factor << up < 1 << 29:  # the shift up goes into constants
            most = (1 << 14 - up) - 1
            low = (v & most) * (factor << up) >> 14
            let(f"u{i}", (v >> 14 - up) * factor + low)
        else:
            v = let("v", v >> shift)
            let(f"u{i}", (v >> 14) * factor + ((v & 16383) * factor >> 14))

    def inputs(self, x: Array) -> Array:
        """The atoms' z as the device has them."""
        env = Code(self.code.lets, self.code.tables).columns(x)
        return np.stack([env[f"u{i}"] for i in range(len(self.atoms))], axis=1) / 2.0**28

    def _keep_bits(self) -> None:
        """Upper and lower halves of the inputs of branches, and of every input the bits that words meet."""
        form, let = self.form, self.code.let
        for i in range(len(self.atoms)):
            u = var(f"u{i}")
            if i in self.branching:
                let(f"a{i}", u >> 14)
                let(f"b{i}", u & 16383)
            for letter, bits in (("p", form.part), ("q", form.high)):
                let(f"{letter}{i}", (u + (1 << 27 - bits)) >> 28 - bits)

    # ---- rows

    def _row(self, poly: Poly, scale: Scale) -> Row:
        """The polynomial in units in which it has room; identity: unit = step * 2^e."""
        constant = poly.get((), 0.0)
        row = Row(np.zeros(len(self.index)), 0.0, 24, scale.name)
        for term, c in poly.items():
            if term:
                row.coefficients[self.index[term]] += c
        if scale.link == "exp":
            row.intercept = constant - math.log(scale.step)
            if abs(row.intercept) + size(poly) > 60:
                most = abs(row.intercept) + size(poly)
                raise CompileError(
                    f"{scale.name} may reach exp({most:.0f}) steps over the box; narrow the box"
                )
            return row
        unit = scale.step * 2.0 ** self.exponent(poly, scale)
        row.coefficients /= unit
        row.intercept = (constant - self.offset(poly, scale) * scale.step) / unit
        return row

    def exponent(self, poly: Poly, scale: Scale) -> int:
        """e of the row's unit."""
        return math.ceil(math.log2(max(size(poly) / _WIDEST, 0.02 * scale.spread) / scale.step))

    def offset(self, poly: Poly, scale: Scale) -> int:
        """Steps that are added at last."""
        return round(poly.get((), 0.0) / scale.step)

    def _sizes(self, row: Row, scale: Scale, terms: Array) -> Array:
        """What an error of the row is relative to, at each vector."""
        y = terms[:, :-1] @ row.coefficients + row.intercept
        if scale.link == "exp":
            return np.clip(scale.tolerated / (scale.step * np.exp(y)), 0.01, 1.0)
        k = self.scales.index(scale)
        unit = scale.step * 2.0 ** self.exponent(self.polys[k], scale)
        return np.full(len(y), scale.tolerated / unit)

    # ---- sums

    def sums(self, j: int) -> Node:
        """Statements of polynomial j: the row in Q24."""
        code, words, form = self.code, self.words[j], self.form
        note = f"{self.scales[j].name}: "
        at = 0
        begun: set[str] = set()
        for step in form.steps:
            target = self._depth(len(step.branch))
            if isinstance(step, Run):
                k = slice(at, at + len(step.features))
                high = ir.dot(words.high[k].tolist(), [f"p{i}" for i in step.features])
                low = ir.dot(words.low[k].tolist(), [f"q{i}" for i in step.features])
                if target in begun:
                    h = self._long("h", high, low, note + self._place(step))
                    code.let(target, var(target) + (h >> form.downs[j]))
                else:
                    self._long(target, high, low, note + self._place(step))
                    code.let(target, var(target) >> form.downs[j]) if form.downs[j] else None
                begun.add(target)
                at = k.stop
            else:
                own = form.own(j, words, at)
                at += 1
                if target in begun:
                    code.let(target, var(target) + own, note + self._product(step.branch))
                else:
                    code.let(target, own, note + self._product(step.branch))
                i = step.branch[-1]
                h, product = ir.mul(target, f"a{i}", f"b{i}")
                code.let("h", h)
                outer = self._depth(len(step.branch) - 1)
                code.let(outer, var(outer) + product if outer in begun else product)
                begun.discard(target)
                begun.add(outer)
        if not form.steps:
            return code.let("t", words.intercept)
        return code.let("t", (var("t") >> words.shift) + words.intercept, note + "sum")

    def _long(self, name: str, high: Node, low: Node, note: str) -> Node:
        """A run's two sums."""
        let, down = self.code.let, self.form.low_sum_shift
        if not low.args[0]:
            return let(name, high, note)
        if not high.args[0]:
            return let(name, low >> down, note)
        if len(high.args[0]) + len(low.args[0]) > 40:
            let(name, high, note)
            g = let("g", low, note)
            return let(name, var(name) + (g >> down))
        return let(name, high + (low >> down), note)

    @staticmethod
    def _depth(n: int) -> str:
        return _DEPTHS[n] if n < len(_DEPTHS) else f"{_DEPTHS[-1]}{n}"

    def _product(self, branch: Term) -> str:
        return " * ".join(self._name(i) for i in branch)

    def _place(self, run: Run) -> str:
        inner = ", ".join(self._name(i) for i in run.features[:8])
        inner += ", .." if len(run.features) > 8 else ""
        return f"{self._product(run.branch)} * ({inner})" if run.branch else f"({inner})"

    # ---- outputs

    def told(self, j: int, t: Node) -> Node:
        """Polynomial j, a row in Q24, as an integer of its steps."""
        scale = self.scales[j]
        if scale.link == "exp":
            return ir.exp(t, 24)
        down = 24 - self.exponent(self.polys[j], scale)
        half = (1 << down - 1) if down > 0 else 0
        return (t + half >> down if half else t >> down) + self.offset(self.polys[j], scale)

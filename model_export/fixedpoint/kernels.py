"""Sums of radial kernels: sum of w_k exp(-|z - s_k|^2), for small Gaussian processes and kernel regressions.

|z - s|^2 = |z|^2 + |s|^2 - 2 z.s: the last part is a polynomial of degree 1 for each support, |z|^2 one of
degree 2 for all of them. Kernels go into the sums as features go into polynomials.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.fixedpoint import ir, pieces, quantise
from palpate.fixedpoint.device import Table
from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.form import Form
from palpate.fixedpoint.ir import Code, Node, var
from palpate.fixedpoint.nested import Run, Term
from palpate.fixedpoint.polynomials import Polynomials, Scale
from palpate.fixedpoint.space import Array, Atom, Feature, Poly, Space, plus, times
from palpate.fixedpoint.word_pairs import Row

MOST_SUPPORTS = 400
FORM = Form(22, 15, 14, (0,), ())
_WIDEST = 30.0
_FARTHEST = (1 << 29) - (1 << 20)
"""Of an output, in its steps: they are chosen so that it stays within 2^29 (`assembly`)."""
_NEGLIGIBLE = -20
"""ln of a kernel that is nothing."""


@dataclass(frozen=True)
class Kernels:
    """exp(-|z - s_k|^2) of columns z (already divided by the kernel's length), times weights.

    Attributes
    ----------
    z : list of Poly
    supports : array (k, len(z))
    weights : array (outputs, k)
    """

    z: Sequence[Poly]
    supports: Array
    weights: Array


class KernelSums:
    """Statements for kernels and the sums of them, with the interface of `Polynomials`."""

    def __init__(
        self, code: Code, space: Space, kernels: Kernels, constants: Sequence[float],
        scales: Sequence[Scale], x: Array,
    ) -> None:  # fmt: skip
        supports = kernels.supports
        if len(supports) > MOST_SUPPORTS:
            raise CompileError(
                f"the kernel has {len(supports)} supports, {MOST_SUPPORTS} at most are compiled; "
                "fit it to fewer rows, or take HistGradientBoostingRegressor"
            )
        self.code, self.scales, self.kernels = code, scales, kernels
        square = plus(*((-1.0, times(z, z)) for z in kernels.z))
        linear = [
            plus(*((2 * float(v), z) for v, z in zip(s, kernels.z)), (-float(s @ s), {(): 1.0}))
            for s in supports
        ]
        common = Polynomials(code, space, [square], [Scale("kernels", 2.0**-24, 1e-6)], x)
        self.atoms = common.atoms
        code.let("e", common.told(0, common.sums(0)), "kernels: -|z|^2, Q24")
        n = len(common.atoms)
        place: dict[Term, int] = {(k,): i for i, k in enumerate(common.atoms)}
        for i in range(n):
            _keep(code, f"u{i}", str(i))
        rows = []
        for k, poly in enumerate(linear):
            row = Row(np.zeros(n), poly.get((), 0.0), 24, f"kernel {k}")
            for term, c in poly.items():
                if term:
                    row.coefficients[place[term]] = c
            rows.append(row)
        z = common.inputs(x)
        sums = _Rows(code, rows, [str(i) for i in range(n)], z, 1e-7)
        table = len(code.tables)
        code.tables.append(_exp_table())
        for k in range(len(rows)):
            code.let("v", sums.row(k) + var("e"), "kernels: -|z - s|^2, Q24")
            code.let("v", ir.clip(var("v"), _NEGLIGIBLE << 24, 0))
            code.let(f"u{n + k}", ir.lookup(var("v"), table))
            _keep(code, f"u{n + k}", str(n + k))
        exponents = (
            np.stack([_evaluated(z, row) for row in rows], axis=1) + _evaluated_square(common, z)[:, None]
        )
        values = 2 * np.exp(np.clip(exponents, _NEGLIGIBLE, 0)) - 1
        outputs = []
        self.exponents, self.offsets = [], []
        for j, scale in enumerate(scales):
            weights, offset = kernels.weights[j], round(constants[j] / scale.step)
            size = float(np.abs(weights).sum()) + abs(float(weights.sum()))
            e = int(np.ceil(np.log2(max(size / 2 / _WIDEST, 0.02 * scale.spread) / scale.step)))
            unit = scale.step * 2.0**e
            rest = constants[j] - offset * scale.step
            outputs.append(Row(weights / 2 / unit, (float(weights.sum()) / 2 + rest) / unit, 24, scale.name))
            self.exponents.append(e)
            self.offsets.append(offset)
        tolerance = min(1e-6 * s.spread / s.step / 2.0**e for s, e in zip(scales, self.exponents))
        self.rows = _Rows(code, outputs, [str(n + k) for k in range(len(rows))], values, tolerance)

    def sums(self, j: int) -> Node:
        """As `Polynomials.sums`."""
        return self.code.let("t", self.rows.row(j), f"{self.scales[j].name}: sum of kernels")

    def link_unit(self, j: int) -> float:
        """As `Polynomials.link_unit`."""
        return self.scales[j].step

    def told(self, j: int, t: Node) -> Node:
        """As `Polynomials.told`."""
        down = 24 - self.exponents[j]
        if down < 0:  # weights that cancel: what none of the values reaches is held, for the proof
            t = ir.clip(t, -(_FARTHEST >> -down), _FARTHEST >> -down)
        return (t + ((1 << down - 1) if down > 0 else 0) >> down) + self.offsets[j]


def _keep(code: Code, u: str, name: str) -> None:
    """An input's bits in the form of linear rows."""
    for letter, bits in (("m", FORM.part), ("n", FORM.high)):
        code.let(f"{letter}{name}", var(u) + (1 << 27 - bits) >> 28 - bits)


class _Rows:
    """Sums of degree 1 over inputs `names`, within +-1, in the form FORM."""

    def __init__(
        self, code: Code, rows: list[Row], names: list[str], inputs: Array, tolerance: float
    ) -> None:
        self.code, self.names, self.given = code, names, rows
        widths = np.full((len(inputs), len(rows)), quantise.WIDTH_ERROR / tolerance)
        self.words, self.runs, self.down = quantise.choose_few(rows, FORM, inputs, widths)

    def row(self, k: int) -> Node:
        """Statements of row k; its value in Q24."""
        words, code = self.words[k], self.code
        note = self.given[k].name
        for number, run in enumerate(self.runs):
            assert isinstance(run, Run)
            at = list(run.features)
            high = ir.dot(words.high[at].tolist(), [f"m{self.names[i]}" for i in at])
            low = ir.dot(words.low[at].tolist(), [f"n{self.names[i]}" for i in at])
            code.let("h", high, note)
            code.let("g", low, note)
            value = var("h") + (var("g") >> FORM.low_sum_shift) >> self.down
            code.let("t", value if number == 0 else var("t") + value)
        return (var("t") >> words.shift) + words.intercept


def _exp_table() -> Table:
    """2 exp(v) - 1 in Q28, of v in Q24 from _NEGLIGIBLE to 0."""
    of = Feature("the exponent", 2.0**-24, _NEGLIGIBLE << 24, 0)
    return pieces.table(_Exp(0, of, 0, lambda v: 2 * np.exp(v) - 1, name="exp"), 4e-9)


class _Exp(Atom):
    """An atom whose value is z itself."""

    centre, radius = 0.0, 1.0  # type: ignore[assignment]


def _evaluated(z: Array, row: Row) -> Array:
    return np.asarray(z @ row.coefficients + row.intercept)


def _evaluated_square(of: Polynomials, z: Array) -> Array:
    total = np.full(len(z), of.polys[0].get((), 0.0))
    place = {k: i for i, k in enumerate(of.atoms)}
    for term, c in of.polys[0].items():
        if term:
            total += c * np.prod(z[:, [place[k] for k in term]], axis=1)
    return total

"""A compiled model's tables as statements: the evaluator's integers without its tables and loops.

Names: u is an input of +-1 in Q28, a and b its upper and lower halves, p and q the bits of it that high and
low words meet; t is a sum; y0, y1, .. are the predictions, told0, .. what the first stage tells; f says
whether the stroke is inside the domain, l whether there is a lump.
"""

from __future__ import annotations

import numpy as np

from firmware_py import evaluator as ev
from firmware_py import features as firmware_features
from firmware_py import outputs, scales, stage, verdict
from palpate.fixedpoint import ir, nested, sums
from palpate.fixedpoint.form import Form
from palpate.fixedpoint.ir import Code, Node, var
from palpate.fixedpoint.nested import Run
from palpate.fixedpoint.word_pairs import Words, split
from palpate.model_export.image_builder import in_order
from palpate.model_export.integers import compiler
from palpate.model_export.schema import OUTPUTS, FirstStage, ModelSpec

N = ev.OUTPUTS
_E = len(outputs.PARTS) * outputs.E_INV23  # its value in `out`; low and high are the next two
_HELD = 1 << 29  # where `scales.scaled` holds its result


class _Part:
    """Features and polynomials, as the model and its stages have them."""

    def __init__(
        self,
        code: Code,
        spec: ModelSpec | FirstStage,
        tables: ev.Tables | stage.Stage,
        places: dict[int, int],
    ) -> None:
        self.code, self.spec, self.t, self.places = code, spec, tables, places
        head = tables.head
        self.n, self.leaves, self.low = head[ev.N_FEATURES], head[ev.LEAVES], head[ev.LOW_BITS]
        count = head[ev.SUMS]
        steps = nested.from_bytes(tables.steps[: head[ev.STEPS]])
        downs = tuple(head[ev.DOWNS] >> 4 * j & 15 for j in range(count))
        self.form = Form(head[ev.PART_BITS], head[ev.HIGH_BITS], self.low, downs, tuple(steps))
        size = count * self.leaves
        whole = in_order(tables, [(c << self.low) + d for c, d in zip(tables.c[:size], tables.d[:size])])
        names = [str(i) for i in range(self.n)]
        titles = [o.name for o in (spec.outputs if isinstance(spec, ModelSpec) else spec.estimates)]
        rows = [self._words(whole[j::count]) for j in range(count)]
        self.sums = sums.Sums(code, self.form, rows, names, spec.features, titles)

    def _words(self, whole: list[int]) -> Words:
        return Words(*split(np.array(whole, np.int64), self.low), 0, 0, 0)

    def feature(self, ident: int) -> Node:
        """A feature: the firmware's, or, behind these, one that the first stage tells."""
        told = ident - firmware_features.COUNT
        return var(f"told{told}" if told >= 0 else f"features[{self.places[ident]}]")

    def inputs(self) -> None:
        """The features within +-1 over the clip box."""
        branching = sums.branching(self.form.steps)
        for i in range(self.n):
            lo, hi, centre, shift, factor = self.t.feats[ev.FEATURE_ROW * i :][: ev.BOX_LO]
            assert max(hi - centre, centre - lo) << max(-shift, 0) <= _HELD  # else it would be held there
            x = self.code.let(f"x{i}", self.feature(self.t.ids[i]), self.spec.features[i])
            sums.standardised(self.code, ir.clip(x, lo, hi), centre, shift, factor, "u")
            if i in branching:
                sums.keep_halves(self.code, var("u"), str(i))
            sums.keep_bits(self.code, var("u"), str(i), self.form)

    def scaled(self, row: int, name: str) -> Node:
        """v: a row's sum with its shift and intercept, as `evaluator` and `scales.scaled` have it."""
        intercept, shift = self.t.rows[ev.ROW * row : ev.ROW * (row + 1)]
        if shift <= 0:
            most = 1 << 29 + shift
            self.code.let(name, ir.clip(var(name), -most, most))
        return self.code.let("v", (var(name) >> shift) + intercept)


class _Stage(_Part):
    """A first stage, or checks."""

    t: stage.Stage

    def value(self, j: int) -> Node:
        """v: value j, held between its ends."""
        self.sums.raw(j)
        v = self.scaled(j, "t")
        return ir.clip(v, *self.t.ends[stage.ENDS * j : stage.ENDS * (j + 1)])


class _Model(_Part):
    """The model itself: outputs, intervals, domain and flags."""

    spec: ModelSpec
    t: ev.Tables

    def output(self, j: int) -> None:
        name, unit = OUTPUTS[j]
        link, lo, hi, mid, shift = self.t.outs[ev.OUTPUT_ROW * j :][: ev.LN_Q_SOFT]
        self.sums.raw(j)
        v = self.scaled(j, "t")
        y = self.code.let(
            f"y{j}", ir.clip(v, lo, hi), f"{name}, {'ln of ' * (link == 1)}millionths of {unit}"
        )
        self.tell(3 * j, y, link)
        self.code.let("u", (y - mid) >> shift)
        sums.keep_bits(self.code, var("u"), f"y{j}", self.form)

    def tell(self, place: int, y: Node, link: int) -> None:
        """Millionths of y into `out`, as `scales.value`."""
        if link == 1:
            value = ir.exp(y, 24)
        elif link:
            value = (y + (1 << link >> 3)) >> link - 2
        else:
            value = ((y >> 12) * 15625 + ((y & 4095) * 15625 >> 12) + 32) >> 6
        self.code.let(f"out[{place}]", value)

    def intervals(self) -> None:
        """The intervals, and f: whether all estimates lie within their ranges and the margin."""
        code, head = self.code, self.t.head
        code.let("f", 1, "half the intervals, from ln sigma and the quantile of the predicted class")
        runs = nested.from_bytes(self.t.steps[head[ev.STEPS] :])
        steps = tuple(Run((), step.features) for step in runs if isinstance(step, Run))
        downs = (head[ev.DOWNS] >> ev.SIGMA_DOWN,) * N
        form = Form(self.form.part, self.form.high, self.low, downs, steps)
        names = [*(f"y{j}" for j in range(N)), *map(str, range(self.n))]
        first, size = N * self.leaves, N * (N + self.n)
        high, low = (np.array(words[first : first + size]) for words in (self.t.c, self.t.d))
        rows = [Words(high[j::N], low[j::N], 0, 0, 0) for j in range(N)]
        labels = [*(name for name, _ in OUTPUTS), *self.spec.features]
        sigma = sums.Sums(code, form, rows, names, labels, [f"ln sigma of {name}" for name, _ in OUTPUTS])
        ends = scales.MIN_LN_WIDTH, scales.MAX_LN_WIDTH
        for j in range(N):
            link, lo, hi, _, _, soft, hard, range_lo, range_hi = self.t.outs[ev.OUTPUT_ROW * j :][
                : ev.OUTPUT_ROW
            ]
            y = var(f"y{j}")
            sigma.raw(j)
            v = code.let("v", ir.clip(self.scaled(N + j, "t"), *ends))
            quantile = soft if soft == hard else ir.pick(var(f"out[{_E}]"), head[ev.HARD_BELOW], hard, soft)
            v = code.let("v", v + quantile)
            v = code.let("v", ir.clip(v, *ends))
            v = code.let("v", ir.exp(v, 0))
            u = code.let("u", y - v)
            self.tell(3 * j + 1, code.let("u", ir.pick(u, lo, lo, u)), link)
            u = code.let("u", y + v)
            self.tell(3 * j + 2, code.let("u", ir.pick(hi, u, hi, u)), link)
            if range_lo > lo or range_hi < hi:
                w = code.let("w", (v >> 8) * head[ev.MARGIN])
                if range_lo > lo:
                    code.let("f", ir.pick(w, ir.node(range_lo) - y, 0, var("f")))
                if range_hi < hi:
                    code.let("f", ir.pick(w, y - range_hi, 0, var("f")))

    def distance(self) -> None:
        """Squared distance from the middle of the domain, a row of its matrix at a time, and the box."""
        code = self.code
        total = code.let("g", 0, "squared distance from the middle of the domain")
        at = N * (self.leaves + N + self.n)
        for i in range(self.n):
            code.let("t", ir.dot(self.t.c[at : at + i + 1], [f"q{k}" for k in range(i + 1)]))
            v = code.let("v", ir.clip(self.scaled(2 * N + i, "t"), -16384, 16384))
            total = code.let("g", total + (v * v >> 3))
            at += i + 1
        far = code.let(f"out[{ev.DISTANCE}]", (total >> 11) * 1000 >> 10)
        code.let("f", ir.pick(1000, far, 0, var("f")))
        for i in range(self.n):
            lo, hi = self.t.feats[ev.FEATURE_ROW * i + ev.BOX_LO :][:2]
            code.let("f", ir.pick(var(f"x{i}"), lo, 0, var("f")), "the domain's box")
            code.let("f", ir.pick(hi, var(f"x{i}"), 0, var("f")))

    def verdict(self) -> None:
        """The flags, and l."""
        code, head, f = self.code, self.t.head, var("f")
        code.let(f"out[{ev.LEVEL}]", head[ev.LEVEL_PERMILLE], "the lump rule")
        code.let("l", 1)
        for ident, lo, hi in zip(*(iter(self.t.limits),) * 3, strict=True):
            x = self.feature(ident)
            if lo > -compiler.NO_LIMIT:
                code.let("l", ir.pick(x, lo, 0, var("l")))
            if hi < compiler.NO_LIMIT:
                code.let("l", ir.pick(hi, x, 0, var("l")))
        border, low, high = head[ev.HARD_BELOW], var(f"out[{_E + 1}]"), var(f"out[{_E + 2}]")
        k = code.let("k", ir.pick(high, border, ev.HARD, ir.pick(low, border, 0, ev.SOFT)), "the flags")
        force = var(f"out[{verdict.FORCE}]")
        out = ir.pick(head[ev.FORCE_HI], force, ev.FORCE_OUT, 0)
        k = code.let("k", k + ir.pick(force, head[ev.FORCE_LO], ev.FORCE_OUT, out))
        k = code.let("k", ir.pick(0, var("l"), k + ev.LUMP, 0))
        code.let(f"out[{ev.FLAGS}]", f * ev.IN_DOMAIN + k)


def of(spec: ModelSpec, tables: ev.Tables, places: dict[int, int]) -> Code:
    """The statements over `features` that leave an estimate in `out`; l is 0 where there is no lump.

    Parameters
    ----------
    spec, tables : the model, and what `compiler.compile_model` made of it
    places : dict
        Where in `features` each of the firmware's features stands, by its index there.
    """
    code = Code()
    if spec.first is not None:
        first = _Stage(code, spec.first, compiler.compile_first(spec.first), places)
        first.inputs()
        for j in range(first.t.count):
            code.let(f"told{j}", first.value(j))
    model = _Model(code, spec, tables, places)
    model.inputs()
    for j in range(N):
        model.output(j)
    model.intervals()
    model.distance()
    if (compiled := compiler.compile_checks(spec)) is not None:
        assert spec.checks is not None
        checks = _Stage(code, spec.checks, compiled, places)
        checks.inputs()
        for j in range(compiled.count):
            v = code.let("v", checks.value(j))
            if compiled.of_press >> j & 1:  # without a press it says nothing
                press = checks.feature(firmware_features.PRESS)
                v = code.let("v", ir.pick(firmware_features.ABSENT, press, v, 0))
            code.let("f", ir.pick(0, v, 0, var("f")))
    model.verdict()
    return code

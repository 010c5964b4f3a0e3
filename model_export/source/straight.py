"""A model's arithmetic as straight-line Python: the evaluator's integers without its tables and loops.

Every constant of the model stands in the expression that uses it, every input in a local variable, every sum
is one expression of products of small integers: what an interpreter is quickest at, and nothing is
allocated. An interpreter's time goes by its operators, not by its loads and stores: words that are zero
have no product. Names: u is an input of +-1 in Q28, a and b its upper and lower halves, p its first bits
(the evaluator's `part`), q fewer of them (`high`); v is a branch's value, t the sum of all; y0, y1, .. are
the predictions.
"""

from __future__ import annotations

from collections.abc import Iterator

from firmware_py import evaluator as ev
from firmware_py import features as firmware_features
from firmware_py import outputs, scales, stage, verdict
from palpate.fixedpoint.nested import Run
from palpate.model_export.fixed_point import compiler
from palpate.model_export.schema import OUTPUTS, FirstStage, ModelSpec
from palpate.model_export.source.compiled_tables import CompiledTables, N
from palpate.model_export.source.expressions import (
    clipped,
    exponential,
    product,
    shifted,
    terms,
    value,
    wrapped,
)

_E = len(outputs.PARTS) * outputs.E_INV23  # its value in `out`; low and high are the next two
_CLIP = 1 << 29  # where `scales.scaled` holds its result

_LN_WIDTHS = (scales.MIN_LN_WIDTH, scales.MAX_LN_WIDTH)


def told_by(spec: FirstStage, compiled: stage.Stage, places: dict[int, int]) -> str:
    """Statements of a first stage, which works on `features` and puts its values into `told`; as `body`."""
    return "\n".join(_StageWriter(spec, compiled, places).values()) + "\n"


def checked_by(spec: FirstStage, compiled: stage.Stage, places: dict[int, int], press: int) -> str:
    """Statements of a model's checks, which return whether none speaks up; as `body`.

    press : the firmware's feature by which it is known whether there was a press
    """
    return "\n".join(_StageWriter(spec, compiled, places).checks(press)) + "\n"


def body(spec: ModelSpec, tables: ev.Tables, places: dict[int, int], whole: bool = True) -> str:
    """Statements, indented by four, that work on `features` and `out`.

    Parameters
    ----------
    spec, tables : the model, and what `compiler.compile_model` made of it
    places : dict
        Where in `features` each of the firmware's features stands, by its index there.
    whole : bool
        Else only the outputs' values, one after the other.
    """
    return "\n".join(_Writer(spec, tables, places).lines(whole)) + "\n"


class _Sums(CompiledTables):
    """Features and polynomials, as the model and its stages have them."""

    def _inputs(self) -> Iterator[str]:
        yield f"    # the features within +-1 over the clip box; p: {self.part} bits of them, q: {self.high}"
        for i in range(self.n):
            yield from self._feature(i)

    # ---- inputs

    def _kept(self, name: str, u: str) -> str:
        """The statements that keep an input's first bits."""
        return "; ".join(
            f"{letter}{name} = {u} + {1 << 27 - bits} >> {28 - bits}"
            for letter, bits in (("p", self.part), ("q", self.high))
        )

    def _where(self, ident: int) -> str:
        """A feature: the firmware's, or, behind these, one that the first stage tells."""
        told = ident - firmware_features.COUNT
        return f"told[{told}]" if told >= 0 else f"features[{self.places[ident]}]"

    def _feature(self, i: int) -> Iterator[str]:
        lo, hi, centre, shift, factor = self.feature_row(i)[: ev.BOX_LO]
        assert max(hi - centre, centre - lo) << max(-shift, 0) <= _CLIP  # the evaluator would hold it there
        yield f"    x{i} = {self._where(self.t.ids[i])}  # {self.spec.features[i]}"
        moved = f"({clipped(f'x{i}', lo, hi)}) - {centre}"
        up = -shift
        if 0 <= up < 14:  # the shift up goes into constants
            yield f"    v = {moved}"
            yield f"    u = (v >> {14 - up}) * {factor} + ((v & {(1 << 14 - up) - 1}) * {factor << up} >> 14)"
        else:
            yield f"    v = {shifted(f'({moved})', shift)}"
            yield f"    u = (v >> 14) * {factor} + ((v & 16383) * {factor} >> 14)"
        if i in self.branching:
            yield f"    a{i} = u >> 14; b{i} = u & 16383"
        yield f"    {self._kept(str(i), 'u')}"

    # ---- sums

    def _run(self, target: str, sign: str, at: int, j: int, names: list[str], down: int) -> Iterator[str]:
        """A run's sum: the products of high words, and those of low words shifted down to them."""
        high, low = self.words(at, j, len(names))
        first = terms(high, [f"p{v}" for v in names])
        lesser = terms(low, [f"q{v}" for v in names])
        yield f"    {target} {sign} ("
        if first != ["0"]:
            yield from wrapped(first, "        ")
        if lesser != ["0"] or first == ["0"]:
            yield "        + (" if first != ["0"] else "        ("
            yield from wrapped(lesser, "            ")
            yield f"            >> {self.low_sum_shift})" if self.low_sum_shift else "        )"
        yield f"        >> {down})" if down else "    )"

    def _polynomial(self, j: int) -> Iterator[str]:
        """Output j's sum in t."""
        at = branch = 0
        begun: set[str] = set()
        for step in self.steps:
            target = "tvw"[len(step.branch)]
            sign = "+=" if target in begun else "="
            if isinstance(step, Run):
                yield from wrapped(self._place(step).split(), "    # ")
                names = [str(i) for i in step.features]
                yield from self._run(target, sign, at, j, names, self.downs[j])
                begun.add(target)
                at += N * len(step.terms)
            else:
                outer = "tvw"[len(step.branch) - 1]
                own = self.t.own[branch + j]
                branch += N
                i = step.branch[-1]
                yield f"    {target} {sign} {own}  # {product(step.branch, self.spec.features)}"
                yield f"    h = {target} >> 14"
                yield (
                    f"    {outer} {'+=' if outer in begun else '='} "
                    f"a{i} * h + (a{i} * ({target} & 16383) + b{i} * h >> 14)"
                )
                begun.discard(target)
                begun.add(outer)

    def _place(self, run: Run) -> str:
        """A run in words."""
        inner = ", ".join(self.spec.features[i] for i in run.features)
        return f"{product(run.branch, self.spec.features)} * ({inner})" if run.branch else f"({inner})"

    def _scaled(self, row: int, name: str, most: int) -> list[str]:
        """What turns a row's sum, which cannot be beyond `most`, into a number with its intercept in v."""
        intercept, shift = self.sum_row(row)
        lines = []
        held = _CLIP if shift >= 0 else 1 << (29 + shift)
        if shift <= 0 and most > held:
            lines.append(f"    {name} = {clipped(name, -held, held)}")
        lines.append(f"    v = {shifted(name, shift)}" + (f" + {intercept}" if intercept else ""))
        return lines


class _StageWriter(_Sums):
    """A first stage, or checks: values of polynomials, held between their ends."""

    def _held(self, j: int) -> Iterator[str]:
        assert isinstance(self.t, stage.Stage) and isinstance(self.spec, FirstStage)
        yield f"    # {self.spec.estimates[j].name}, Q24"
        yield from self._polynomial(j)
        yield from self._scaled(j, "t", 1 << 30)
        yield f"    v = {clipped('v', *self.t.ends[stage.ENDS * j : stage.ENDS * (j + 1)])}"

    def values(self) -> Iterator[str]:
        assert isinstance(self.t, stage.Stage)
        yield from self._inputs()
        for j in range(self.t.count):
            yield from self._held(j)
            yield f"    told[{j}] = v"

    def checks(self, press: int) -> Iterator[str]:
        assert isinstance(self.t, stage.Stage)
        yield from self._inputs()
        for j in range(self.t.count):
            yield from self._held(j)
            pressed = f" and features[{self.places[press]}] != {firmware_features.ABSENT}"
            yield f"    if v > 0{pressed if self.t.of_press >> j & 1 else ''}:"
            yield "        return False"
        yield "    return True"


class _Writer(_Sums):
    """The model itself: outputs, intervals, domain and flags."""

    spec: ModelSpec
    t: ev.Tables

    def lines(self, whole: bool) -> Iterator[str]:
        if self.spec.first is not None:
            yield "    told = _TOLD"
            yield "    _first(features, told)"
        yield from self._inputs()
        for j in range(N):
            yield from self._output(j, whole)
        if whole:
            yield from self._intervals()
            yield from self._distance()
            yield from self._verdict()

    def _output(self, j: int, whole: bool) -> Iterator[str]:
        name, unit = OUTPUTS[j]
        link, lo, hi, mid, shift = self.output_row(j)[: ev.LN_Q_SOFT]
        yield f"    # {name}: ln of millionths of {unit}, Q24" if link else f"    # {name}, Q24"
        yield from self._polynomial(j)
        yield from self._scaled(j, "t", 1 << 30)
        yield f"    y{j} = {clipped('v', lo, hi)}"
        yield from value(3 * j if whole else j, f"y{j}", link)
        if whole:
            yield f"    u = {shifted(f'(y{j} - {mid})', shift)}"
            yield f"    {self._kept(f'y{j}', 'u')}"

    # ---- intervals, domain, flags

    def _intervals(self) -> Iterator[str]:
        head = self.t.head
        yield "    # half the intervals, from ln sigma and the quantile of the predicted class"
        yield f"    hard = out[{_E}] < {head[ev.HARD_BELOW]}"
        yield "    inside = True"
        for j, (name, _) in enumerate(OUTPUTS):
            link, lo, hi, _, _, soft, hard, range_lo, range_hi = self.output_row(j)
            yield f"    # {name}"
            at, most = N * self.leaves, 0
            for step in self.runs:
                assert isinstance(step, Run)
                names = [self.named[i] for i in step.features]
                yield from self._run("v", "+=" if most else "=", at, j, names, self.downs[N])
                high, low = self.words(at, j, len(names))
                size = (sum(map(abs, high)) << self.part) + (
                    sum(map(abs, low)) << self.high >> self.low_sum_shift
                )
                most += (size >> self.downs[N]) + 2
                at += N * len(names)
            yield from self._scaled(N + j, "v", most)
            least, most = _LN_WIDTHS
            if soft == hard:  # held before and after it is added: the same as once, to the narrower ends
                yield f"    v += {soft}"
                least, most = max(least, least + soft), min(most, most + soft)
            else:
                yield f"    v = {clipped('v', least, most)}"
                yield f"    v += {hard} if hard else {soft}"
            yield f"    v = {clipped('v', least, most)}"
            yield from exponential("v", 0, "v")
            yield f"    u = y{j} - v"
            yield from value(3 * j + 1, f"u if u > {lo} else {lo}", link)
            yield f"    u = y{j} + v"
            yield from value(3 * j + 2, f"u if u < {hi} else {hi}", link)
            beyond = [f"{range_lo} - y{j} > v"] if range_lo > lo else []
            beyond += [f"y{j} - {range_hi} > v"] if range_hi < hi else []
            if beyond:
                yield f"    v = (v >> 8) * {head[ev.MARGIN]}"
                yield f"    if {' or '.join(beyond)}:"
                yield "        inside = False"

    def _distance(self) -> Iterator[str]:
        yield "    # squared distance from the middle of the domain, a row of its matrix at a time"
        yield "    total = 0"
        at = N * (self.leaves + N + self.n)
        for i in range(self.n):
            words = terms(self.t.c[at : at + i + 1], [f"q{k}" for k in range(i + 1)])
            yield from ["    v = (", *wrapped(words, "        "), "    )"]
            yield from self._scaled(2 * N + i, "v", 1 << 30)
            intercept, shift = self.sum_row(2 * N + i)
            most = sum(abs(c) for c in self.t.c[at : at + i + 1]) << self.high
            if shift < 0 or (most >> shift) + abs(intercept) >= 16384:
                yield f"    v = {clipped('v', -16384, 16384)}"
            yield "    total += v * v >> 3"
            at += i + 1
        yield f"    out[{ev.DISTANCE}] = (total >> 11) * 1000 >> 10"

    def _verdict(self) -> Iterator[str]:
        head = self.t.head
        yield f"    out[{ev.LEVEL}] = {head[ev.LEVEL_PERMILLE]}"
        yield f"    if out[{ev.DISTANCE}] > 1000:"
        yield "        inside = False"
        yield "    # the domain's box"
        for i in range(self.n):
            lo, hi = self.feature_row(i)[ev.BOX_LO :]
            yield f"    if x{i} < {lo} or x{i} > {hi}:  # {self.spec.features[i]}"
            yield "        inside = False"
        if self.spec.checks is not None:
            told = "told" if self.spec.first is not None else "None"
            yield f"    if not _checks(features, {told}):"
            yield "        inside = False"
        yield f"    flags = {ev.IN_DOMAIN} if inside else 0"
        conditions = []
        for ident, lo, hi in zip(*(iter(self.t.limits),) * 3, strict=True):
            low = f"{lo} <= " if lo > -compiler.NO_LIMIT else ""
            high = f" <= {hi}" if hi < compiler.NO_LIMIT else ""
            if low or high:
                conditions.append(f"{low}{self._where(ident)}{high}")
        if conditions:
            yield "    # the lump rule"
            yield f"    if not ({' and '.join(conditions)}):"
            yield f"        for i in range({outputs.VALUES}):"
            yield "            out[i] = 0"
            yield f"        out[{ev.FLAGS}] = flags"
            yield f"        return {ev.NO_LUMP}"
        yield f"    flags |= {ev.LUMP}"
        yield f"    if out[{_E + 2}] < {head[ev.HARD_BELOW]}:"
        yield f"        flags |= {ev.HARD}"
        yield f"    elif out[{_E + 1}] >= {head[ev.HARD_BELOW]}:"
        yield f"        flags |= {ev.SOFT}"
        force, lo, hi = f"out[{verdict.FORCE}]", head[ev.FORCE_LO], head[ev.FORCE_HI]
        yield f"    if {force} < {lo} or {force} > {hi}:"
        yield f"        flags |= {ev.FORCE_OUT}"
        yield f"    out[{ev.FLAGS}] = flags"
        yield "    return 0"

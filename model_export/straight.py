"""A model's arithmetic as straight-line Python: the evaluator's integers without its tables and loops.

Every constant of the model stands in the expression that uses it, every input in a local variable, every sum
is one expression of products of small integers: what an interpreter is quickest at, and nothing is
allocated. Names: u is an input of +-1 in Q28, p its first bits (the evaluator's `part`), q its first 13
(`high`), r the bits after these (`rest`), a and b upper and lower halves for products; y0 to y4 are the
predictions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from firmware_py import evaluator as ev
from model_export import compiler
from model_export.schema import OUTPUTS, ModelSpec, Term

_WIDE = 118  # columns
_CLIP = 1 << 29  # where `evaluator.scaled` holds its result

_LN_WIDTHS = (ev._MIN_LN_WIDTH, ev._MAX_LN_WIDTH)


def body(spec: ModelSpec, tables: ev.Tables, places: dict[int, int], whole: bool = True) -> str:
    """Statements, indented by four, that work on `features` and `out`.

    Parameters
    ----------
    spec, tables : the model, and what `compiler.compile_model` made of it
    places : dict
        Where in `features` each of the firmware's features stands, by its index there.
    whole : bool
        Else only the five values, into out[0..4].
    """
    return "\n".join(_Writer(spec, tables, places).lines(whole)) + "\n"


def product(term: Term, names: tuple[str, ...]) -> str:
    """A term in words."""
    return " * ".join(names[i] for i in term)


def _shifted(text: str, by: int) -> str:
    """`text` over 2^by."""
    if by == 0:
        return text
    return f"({text} >> {by})" if by > 0 else f"({text} << {-by})"


def _clipped(name: str, lo: int, hi: int) -> str:
    return f"{lo} if {name} < {lo} else {hi} if {name} > {hi} else {name}"


def _wrapped(words: list[str], indent: str) -> list[str]:
    """Words in lines that are not too long."""
    lines = [indent + words[0]]
    for word in words[1:]:
        if len(lines[-1]) + 1 + len(word) > _WIDE:
            lines.append(indent + word)
        else:
            lines[-1] += " " + word
    return lines


def _terms(coefficients: Iterable[int], names: Iterable[str]) -> list[str]:
    """The sum of products as words, each with its sign in front; none that is nothing."""
    words: list[str] = []
    for c, name in zip(coefficients, names, strict=True):
        if c:
            sign = "-" if c < 0 else "+" if words else ""
            words.append(f"{sign} {abs(c)} * {name}".strip() if words else f"{c} * {name}")
    return words or ["0"]


def _exponential(what: str, s: int, target: str) -> Iterator[str]:
    """`evaluator.exp`, whose ends no prediction and no width can reach."""
    yield f"    w = {what}; k = w // 181704; w -= k * 181704 + (k * 3 >> 3); m = _POWERS[k & 63]; h = w >> 3"
    yield f"    w += h * h >> 19; m += (m >> 10) * (w >> 3) >> 11; k = {s} - (k >> 6)"
    yield f"    {target} = m + (1 << k - 1) >> k if k > 0 else m << -k"


def _value(place: int, y: str, link: int) -> Iterator[str]:
    """Millionths of y into `out`."""
    if link:
        yield from _exponential(y, 24, f"out[{place}]")
    else:
        yield f"    w = {y}"
        yield f"    out[{place}] = (w >> 12) * 15625 + ((w & 4095) * 15625 >> 12) + 32 >> 6"


class _Writer:
    def __init__(self, spec: ModelSpec, tables: ev.Tables, places: dict[int, int]) -> None:
        self.spec = spec
        self.t = tables
        self.places = places
        self.order, self.n_sigma = compiler.term_order(spec)
        head = tables.head
        self.n, self.terms = head[ev.N_FEATURES], head[ev.N_TERMS]
        self.low, self.part, self.fine = head[ev.LOW_BITS], head[ev.PART_BITS], head[ev.FINE]
        self.cut = self.low + 13 - self.part
        self.factors = set(tables.steps)
        self.named = [f"y{j}" for j in range(5)] + [str(k) for k in range(self.terms)]

    def lines(self, whole: bool) -> Iterator[str]:
        yield f"    # the features within +-1 over the clip box; p: {self.part} bits of them, q: 13"
        for i in range(self.n):
            yield from self._feature(i)
        if self.terms > self.n:
            yield "    # their products"
        for k in range(self.n, self.terms):
            yield from self._product(k)
        for j in range(5):
            yield from self._output(j, whole)
        if whole:
            yield from self._intervals()
            yield from self._distance()
            yield from self._verdict()

    # ---- inputs

    def _kept(self, name: str, u: str) -> str:
        """The statements that keep an input's parts."""
        parts = [f"q{name} = {u} >> 15"]
        if self.fine:
            parts.append(f"r{name} = {u} >> {15 - self.low} & {(1 << self.low) - 1}")
        else:
            parts.insert(0, f"p{name} = {u} >> {28 - self.part}")
        return "; ".join(parts)

    def _halved(self, k: int) -> bool:
        """Is term k a factor of another?"""
        return k in self.factors

    def _feature(self, i: int) -> Iterator[str]:
        lo, hi, centre, shift, factor = self.t.feats[7 * i : 7 * i + 5]
        assert max(hi - centre, centre - lo) << max(-shift, 0) <= _CLIP  # the evaluator would hold it there
        yield f"    x{i} = features[{self.places[self.t.ids[i]]}]  # {self.spec.features[i]}"
        moved = f"({_clipped(f'x{i}', lo, hi)}) - {centre}"
        up = -shift
        if 0 <= up < 14:  # the shift up goes into constants
            yield f"    v = {moved}"
            yield f"    u = (v >> {14 - up}) * {factor} + ((v & {(1 << 14 - up) - 1}) * {factor << up} >> 14)"
        else:
            yield f"    v = {_shifted(f'({moved})', shift)}"
            yield f"    u = (v >> 14) * {factor} + ((v & 16383) * {factor} >> 14)"
        if self._halved(i) and self.fine:
            yield f"    a{i} = u >> 14; b{i} = u & 16383"
        yield f"    {self._kept(str(i), 'u')}"
        if self._halved(i) and not self.fine:
            yield f"    a{i} = p{i} >> 10; b{i} = p{i} & 1023"

    def _product(self, k: int) -> Iterator[str]:
        i, j = self.t.steps[2 * (k - self.n) : 2 * (k - self.n) + 2]
        comment = f"  # {product(self.order[k], self.spec.features)}"
        if self.fine:
            yield f"    u = a{i} * a{j} + (a{i} * b{j} + a{j} * b{i} >> 14){comment}"
            if self._halved(k):
                yield f"    a{k} = u >> 14; b{k} = u & 16383"
            yield f"    {self._kept(str(k), 'u')}"
        else:
            yield f"    p{k} = p{i} * a{j} + (p{i} * b{j} >> 10) >> {self.part - 10}{comment}"
            yield f"    q{k} = p{k} >> {self.part - 13}"

    # ---- sums

    def _words(self, at: int, j: int, n: int) -> tuple[list[int], list[int]]:
        """High and low words of sum j of the five whose words begin at `at`, over n inputs."""
        where = range(at + j, at + 5 * n, 5)
        return [self.t.c[i] for i in where], [self.t.d[i] for i in where]

    def _sum(self, at: int, j: int, names: list[str], groups: list[tuple[int, int]], down: int) -> list[str]:
        """Lines of a sum, in brackets: over each group the first products, and the lesser ones cut down."""
        high, low = self._words(at, j, len(names))
        lines: list[str] = []
        for a, b in groups:
            first = _terms(high[a:b], [("q" if self.fine else "p") + v for v in names[a:b]])
            lesser, inputs = low[a:b], [f"q{v}" for v in names[a:b]]
            if self.fine:
                lesser, inputs = lesser + high[a:b], inputs + [f"r{v}" for v in names[a:b]]
            lines += ["        + (" if lines else "        ("]
            lines += _wrapped(first, "            ")
            lines += ["            + ("]
            lines += _wrapped(_terms(lesser, inputs), "                ")
            lines += [f"                >> {self.cut})" if self.cut else "            )"]
            lines += [f"            >> {down})" if down else "        )"]
        return lines

    def _scaled(self, row: int) -> list[str]:
        """What turns a row's sum v into a number with its intercept."""
        intercept, shift = self.t.rows[2 * row : 2 * row + 2]
        lines = []
        most = _CLIP if shift >= 0 else 1 << (29 + shift)
        if shift <= 0:
            lines.append(f"    v = {_clipped('v', -most, most)}")
        if shift or intercept:
            lines.append(f"    v = {_shifted('v', shift)}" + (f" + {intercept}" if intercept else ""))
        return lines

    def _output(self, j: int, whole: bool) -> Iterator[str]:
        name, unit = OUTPUTS[j]
        link, lo, hi, mid, shift = self.t.outs[9 * j : 9 * j + 5]
        ends = [end - 5 for end in self.t.head[ev.HEAD :]]
        groups = list(zip([0, *ends], ends))
        yield f"    # {name}: ln of millionths of {unit}, Q24" if link else f"    # {name}, Q24"
        yield "    v = ("
        yield from self._sum(0, j, self.named[5:], groups, self.t.head[ev.GROUP_SHIFT])
        yield "    )"
        yield from self._scaled(j)
        yield f"    y{j} = {_clipped('v', lo, hi)}"
        yield from _value(3 * j if whole else j, f"y{j}", link)
        if whole:
            if self.fine:
                yield f"    u = {_shifted(f'(y{j} - {mid})', shift)}"
                yield f"    {self._kept(f'y{j}', 'u')}"
            else:
                yield f"    py{j} = {_shifted(f'(y{j} - {mid})', shift + 28 - self.part)}"
                yield f"    qy{j} = py{j} >> {self.part - 13}"

    # ---- intervals, domain, flags

    def _intervals(self) -> Iterator[str]:
        head, at = self.t.head, 5 * self.terms
        names = self.named[: 5 + self.n_sigma]
        yield "    # half the intervals, from ln sigma and the quantile of the predicted class"
        yield f"    hard = out[12] < {head[ev.HARD_BELOW]}"
        yield "    inside = True"
        for j, (name, _) in enumerate(OUTPUTS):
            link, lo, hi = self.t.outs[9 * j : 9 * j + 3]
            soft, hard, range_lo, range_hi = self.t.outs[9 * j + 5 : 9 * j + 9]
            yield f"    # {name}"
            yield "    v = ("
            yield from self._sum(at, j, names, [(0, len(names))], 0)
            yield "    )"
            yield from self._scaled(5 + j)
            least, most = _LN_WIDTHS
            if soft == hard:  # held before and after it is added: the same as once, to the narrower ends
                yield f"    v += {soft}"
                least, most = max(least, least + soft), min(most, most + soft)
            else:
                yield f"    v = {_clipped('v', least, most)}"
                yield f"    v += {hard} if hard else {soft}"
            yield f"    v = {_clipped('v', least, most)}"
            yield from _exponential("v", 0, "v")
            yield f"    u = y{j} - v"
            yield from _value(3 * j + 1, f"u if u > {lo} else {lo}", link)
            yield f"    u = y{j} + v"
            yield from _value(3 * j + 2, f"u if u < {hi} else {hi}", link)
            beyond = [f"{range_lo} - y{j} > v"] if range_lo > lo else []
            beyond += [f"y{j} - {range_hi} > v"] if range_hi < hi else []
            if beyond:
                yield f"    v = (v >> 8) * {head[ev.MARGIN]}"
                yield f"    if {' or '.join(beyond)}:"
                yield "        inside = False"

    def _distance(self) -> Iterator[str]:
        yield "    # squared distance from the middle of the domain, a row of its matrix at a time"
        yield "    total = 0"
        at = 5 * (self.terms + 5 + self.n_sigma)
        for i in range(self.n):
            words = _terms(self.t.c[at : at + i + 1], [f"q{k}" for k in range(i + 1)])
            yield from ["    v = (", *_wrapped(words, "        "), "    )"]
            yield from self._scaled(10 + i)
            intercept, shift = self.t.rows[20 + 2 * i : 22 + 2 * i]
            most = sum(abs(c) for c in self.t.c[at : at + i + 1]) << 13
            if shift < 0 or (most >> shift) + abs(intercept) >= 16384:
                yield f"    v = {_clipped('v', -16384, 16384)}"
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
            lo, hi = self.t.feats[7 * i + 5 : 7 * i + 7]
            yield f"    if x{i} < {lo} or x{i} > {hi}:  # {self.spec.features[i]}"
            yield "        inside = False"
        yield f"    flags = {ev.IN_DOMAIN} if inside else 0"
        conditions = []
        for ident, lo, hi in zip(*(iter(self.t.limits),) * 3, strict=True):
            low = f"{lo} <= " if lo > -compiler.NO_LIMIT else ""
            high = f" <= {hi}" if hi < compiler.NO_LIMIT else ""
            if low or high:
                conditions.append(f"{low}features[{self.places[ident]}]{high}")
        if conditions:
            yield "    # the lump rule"
            yield f"    if not ({' and '.join(conditions)}):"
            yield "        for i in range(15):"
            yield "            out[i] = 0"
            yield f"        out[{ev.FLAGS}] = flags"
            yield f"        return {ev.NO_LUMP}"
        yield f"    flags |= {ev.LUMP}"
        yield f"    if out[14] < {head[ev.HARD_BELOW]}:"
        yield f"        flags |= {ev.HARD}"
        yield f"    elif out[13] >= {head[ev.HARD_BELOW]}:"
        yield f"        flags |= {ev.SOFT}"
        yield f"    if out[0] < {head[ev.FORCE_LO]} or out[0] > {head[ev.FORCE_HI]}:"
        yield f"        flags |= {ev.FORCE_OUT}"
        yield f"    out[{ev.FLAGS}] = flags"
        yield "    return 0"

"""A model's terms as the nested program that the firmware runs (`firmware_py.polynomial`).

Terms are sorted tuples of feature indices. A pair whose products with further features are in the model, and
a feature of any pair, is a *branch*; what goes no further is a *leaf* of the branch before it. A term of
degree 3 goes on from whichever of its three pairs the fewest branches are made with.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations

from firmware_py import evaluator

Term = tuple[int, ...]
"""A monomial: indices of its features, ascending; () is the constant."""

CLOSE = 128  # a step's first byte: close the branch
DEEPER = 32  # and its depth
FIRST_FEATURE = evaluator.OUTPUTS  # among the inputs: the predictions come first
SIGMA: Term = (-1, -1, -1)  # stands for ln sigma's sums, which are runs of the predictions and the features


@dataclass(frozen=True)
class Run:
    """Leaves whose products are one sum: `branch` times each of the features."""

    branch: Term
    features: tuple[int, ...]

    @property
    def terms(self) -> list[Term]:
        """The terms, in order."""
        return [tuple(sorted((*self.branch, i))) for i in self.features]

    def split(self, n: int) -> tuple[Run, Run]:
        """The first n leaves and the rest."""
        return Run(self.branch, self.features[:n]), Run(self.branch, self.features[n:])


@dataclass(frozen=True)
class Close:
    """The end of a branch: its value times its last feature goes into the branch before it."""

    branch: Term

    @property
    def terms(self) -> list[Term]:
        """The one term that it represents."""
        return [tuple(sorted(self.branch))]


Step = Run | Close


def program(terms: Iterable[Term]) -> list[Step]:
    """Steps that evaluate these terms (and such as stand between), with runs as long as can be."""
    terms = set(terms)
    if any(len(t) > 3 for t in terms):
        return list(_of_any_degree((), {t for t in terms if t}))
    leaves: dict[Term, list[int]] = {}
    for pair, third in _pairs({t for t in terms if len(t) == 3}):
        leaves.setdefault(pair, []).append(third)
    pairs = {t for t in terms if len(t) == 2} | set(leaves)
    single = {t[0] for t in terms if len(t) == 1}
    return list(_steps(single, pairs, leaves))


def _of_any_degree(branch: Term, terms: set[Term]) -> Iterator[Step]:
    """Terms behind a branch: the feature that most of them have is the next branch, while there is one."""
    while any(len(t) > 1 for t in terms):
        counts = Counter(i for t in terms if len(t) > 1 for i in set(t))
        i = min(counts, key=lambda k: (-counts[k], k))
        inner = set()
        for term in [t for t in terms if i in t]:
            left = list(term)
            left.remove(i)
            inner.add(tuple(left))
            terms = terms - {term}
        yield from _of_any_degree((*branch, i), inner - {()})
        yield Close((*branch, i))
    if terms:
        yield Run(branch, tuple(sorted(t[0] for t in terms)))


def _steps(single: set[int], pairs: set[Term], leaves: dict[Term, list[int]]) -> Iterator[Step]:
    branches = {i for i, _ in pairs}
    for i in sorted(branches):
        for pair in sorted(p for p in pairs if p[0] == i):
            if pair in leaves:
                yield Run(pair, tuple(sorted(leaves[pair])))
                yield Close(pair)
        last = tuple(sorted(j for a, j in pairs if a == i and (a, j) not in leaves))
        if last:
            yield Run((i,), last)
        yield Close((i,))
    rest = tuple(sorted(single - branches))
    if rest:
        yield Run((), rest)


def _pairs(cubic: set[Term]) -> Iterator[tuple[Term, int]]:
    """For each term of degree 3 the pair it extends and its third feature: few pairs, chosen greedily."""
    while cubic:
        counts = Counter(pair for term in sorted(cubic) for pair in set(combinations(term, 2)))
        pair = min(counts, key=lambda p: (-counts[p], p))
        for term in sorted(t for t in cubic if pair in combinations(t, 2)):
            left = list(term)
            left.remove(pair[0])
            left.remove(pair[1])
            yield pair, left[0]
            cubic = cubic - {term}


def order(steps: Iterable[Step]) -> list[Term]:
    """The terms in the order in which their words stand."""
    return [term for step in steps for term in step.terms]


def to_bytes(steps: Iterable[Step]) -> bytes:
    """As the firmware reads them."""
    out = bytearray()
    for step in steps:
        depth = DEEPER * len(step.branch)
        if isinstance(step, Run):
            first = 0 if step.branch == SIGMA else FIRST_FEATURE
            out += bytes((depth + len(step.features), *(first + i for i in step.features)))
        else:
            out += bytes((CLOSE + depth, step.branch[-1]))
    return bytes(out)


def from_bytes(raw: bytes) -> list[Step]:
    """The steps again, with their branches' names."""
    found: list[tuple[int, bytes]] = []
    at = 0
    while at < len(raw):
        n = 1 if raw[at] & CLOSE else raw[at] % DEEPER
        found.append((raw[at], raw[at + 1 : at + 1 + n]))
        at += 1 + n
    steps: list[Step] = []
    # a branch's name is known when it is closed: go backwards
    branch: list[int] = []
    for head, inputs in reversed(found):
        depth = head // DEEPER % 4
        if head & CLOSE:
            branch[depth - 1 :] = [inputs[0]]
            steps.append(Close(tuple(branch[:depth])))
        elif depth == len(SIGMA):
            steps.append(Run(SIGMA, tuple(inputs)))
        else:
            steps.append(Run(tuple(branch[:depth]), tuple(i - FIRST_FEATURE for i in inputs)))
    return steps[::-1]

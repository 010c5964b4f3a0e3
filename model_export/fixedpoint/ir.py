"""Integer arithmetic as data: statements that can be proved, run in numpy, and written as source.

An expression is a `Node`; Python's own operators make one, so that what builds a program reads like the
arithmetic that it stands for. A program is a list of statements, each of which gives a name a value; names
may be given another one later.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.fixedpoint import device, intervals
from palpate.fixedpoint.errors import ProofError
from palpate.fixedpoint.intervals import Interval, Proof, hull

Tree = int | tuple[int, int, "Tree", "Tree"]
"""A leaf, or (feature, threshold, where x <= threshold, where not)."""


class Node:
    """An operation and what it works on: nodes, or numbers where the operation wants numbers."""

    __slots__ = ("args", "op")

    def __init__(self, op: str, *args: Any) -> None:
        self.op = op
        self.args = args

    def __add__(self, other: Node | int) -> Node:
        if isinstance(other, int) and other <= 0:
            return Node("-", self, node(-other)) if other else self
        return Node("+", self, node(other))

    def __sub__(self, other: Node | int) -> Node:
        return self + -other if isinstance(other, int) else Node("-", self, other)

    def __mul__(self, other: Node | int) -> Node:
        return Node("*", self, node(other))

    def __rshift__(self, by: int) -> Node:
        return self if by == 0 else Node(">>", self, by) if by > 0 else Node("<<", self, -by)

    def __lshift__(self, by: int) -> Node:
        return self >> -by

    def __and__(self, mask: int) -> Node:
        return Node("&", self, mask)


def node(value: Node | int) -> Node:
    """A node; of a number, that number."""
    return value if isinstance(value, Node) else Node("number", int(value))


def var(name: str) -> Node:
    """The value that a name has by now."""
    return Node("var", name)


def clip(value: Node, lo: int, hi: int) -> Node:
    """A variable held between two numbers."""
    return Node("clip", value, lo, hi)


def pick(a: Node | int, b: Node | int, below: Node | int, above: Node | int) -> Node:
    """`below` where a < b, else `above`."""
    return Node("pick", node(a), node(b), node(below), node(above))


def dot(coefficients: Sequence[int], names: Sequence[str]) -> Node:
    """Sum of products; words that are zero have none."""
    kept = [(int(c), name) for c, name in zip(coefficients, names, strict=True) if c]
    return Node("dot", tuple(c for c, _ in kept), tuple(name for _, name in kept))


def mul(v: str, a: str, b: str) -> tuple[Node, Node]:
    """v times a Q28 number whose upper and lower halves are a and b: first `h`, then the product with it.

    The product of the two low halves is below what is kept.
    """
    return var(v) >> 14, var(a) * var("h") + ((var(a) * (var(v) & 16383) + var(b) * var("h")) >> 14)


def exp(value: Node, s: int) -> Node:
    """`scales.exp`: exp(value / 2^24) in Q(24 - s)."""
    return Node("exp", value, s)


def lookup(value: Node, table: int) -> Node:
    """`device.lookup` in the program's table of that number."""
    return Node("lookup", value, table)


def tree(number: int) -> Node:
    """The leaf that the program's tree of that number gives for the features."""
    return Node("tree", number)


@dataclass(frozen=True)
class Let:
    """A statement: `name` is `value` from here on; `note` says what it is."""

    name: str
    value: Node
    note: str = ""


@dataclass
class Code:
    """Statements over the features x[0], x[1], .., which leave what they find in out[0], out[1], ..

    Attributes
    ----------
    lets : list of Let
    tables : list of device.Table
    trees : list of Tree
    """

    lets: list[Let] = field(default_factory=list)
    tables: list[device.Table] = field(default_factory=list)
    trees: list[Tree] = field(default_factory=list)

    def let(self, name: str, value: Node | int, note: str = "") -> Node:
        """Append a statement; the variable."""
        self.lets.append(Let(name, node(value), note))
        return var(name)

    def needed(self) -> Code:
        """The same without statements whose values nothing takes."""
        live: set[str] = set()
        kept = []
        for let in reversed(self.lets):
            if let.name in live or let.name.startswith("out["):
                kept.append(let)
                live.discard(let.name)
                live |= set(names_in(let.value))
        return Code(kept[::-1], self.tables, self.trees)

    def prove(self, boxes: Sequence[tuple[int, int]], outputs: int) -> tuple[Proof, list[tuple[int, int]]]:
        """Run on ranges: the proof, and each output's range; ProofError says which statement may overflow.

        Parameters
        ----------
        boxes : list of (int, int)
            The range of each feature as the device may hand it over.
        """
        env: dict[str, Any] = {f"x[{i}]": Interval(*box) for i, box in enumerate(boxes)}
        walk = _Ranges(self, env)
        Interval.operations = Interval.largest = 0
        where = ""
        for let in self.lets:
            before = Interval.largest
            try:
                env[let.name] = walk.value(let.value)
            except ProofError as error:
                raise ProofError(f"{error}, in {let.note or let.name}") from None
            if Interval.largest > before:
                where = let.note or let.name
        ends = [hull(env[f"out[{k}]"]) for k in range(outputs)]
        return Proof(Interval.largest, Interval.operations, where), [(e.lo, e.hi) for e in ends]

    def run(self, x: np.ndarray, outputs: int) -> np.ndarray:
        """The integers for features x, n x features of int64: n x outputs."""
        env = self.columns(x)
        zero = np.zeros(len(x), np.int64)
        return np.stack([env[f"out[{k}]"] + zero for k in range(outputs)], axis=1)

    def columns(self, x: np.ndarray) -> dict[str, Any]:
        """Every name's last value for features x."""
        env: dict[str, Any] = {f"x[{i}]": x[:, i] for i in range(x.shape[1])}
        walk = _Columns(self, env, x)
        for let in self.lets:
            env[let.name] = walk.value(let.value)
        return env


class _Walk:
    """What both ways to run an expression share."""

    def __init__(self, code: Code, env: Mapping[str, Any]) -> None:
        self.code, self.env = code, env
        self.operations: dict[str, Callable[..., Any]] = {
            "number": lambda n: n,
            "var": env.__getitem__,
            "dot": self._dot,
            "+": lambda a, b: self.value(a) + self.value(b),
            "-": lambda a, b: self.value(a) - self.value(b),
            "*": lambda a, b: self.value(a) * self.value(b),
            ">>": lambda a, s: self.value(a) >> s,
            "<<": lambda a, s: self.value(a) * (1 << s),
            "&": lambda a, mask: self.value(a) & mask,
        }

    def value(self, of: Node) -> Any:
        return self.operations[of.op](*of.args)

    def _dot(self, coefficients: tuple[int, ...], names: tuple[str, ...]) -> Any:
        total: Any = 0
        for c, name in zip(coefficients, names):
            total = total + self.env[name] * c
        return total


class _Ranges(_Walk):
    """On intervals."""

    def __init__(self, code: Code, env: Mapping[str, Any]) -> None:
        super().__init__(code, env)
        self.operations |= {
            "number": lambda n: Interval(n, n),
            "clip": lambda v, lo, hi: intervals.clip(self.value(v), lo, hi),
            "pick": self._pick,
            "exp": lambda v, s: intervals.exp(self.value(v), s),
            "lookup": lambda v, table: code.tables[table].over(hull(self.value(v))),
            "tree": lambda k: Interval(*leaf_ends(code.trees[k])),
        }

    def _pick(self, a: Node, b: Node, below: Node, above: Node) -> Any:
        # compared, not computed with: a feature that is anything at all takes nothing of the margin
        (least, most), (lo, hi) = intervals.ends(self.value(a)), intervals.ends(self.value(b))
        if most < lo:
            return self.value(below)
        if least >= hi:
            return self.value(above)
        return hull(self.value(below), self.value(above))


class _Columns(_Walk):
    """On columns of int64."""

    def __init__(self, code: Code, env: Mapping[str, Any], x: np.ndarray) -> None:
        super().__init__(code, env)
        self.operations |= {
            "clip": lambda v, lo, hi: np.clip(self.value(v), lo, hi),
            "pick": lambda a, b, below, above: np.where(
                self.value(a) < self.value(b), self.value(below), self.value(above)
            ),
            "exp": lambda v, s: device.exp_of(np.asarray(self.value(v)), s),
            "lookup": lambda v, table: code.tables[table].of(self.value(v)),
            "tree": lambda k: _leaves(code.trees[k], x),
        }


def names_in(of: Node) -> Iterator[str]:
    """The variables of an expression."""
    if of.op == "var":
        yield of.args[0]
    elif of.op == "dot":
        yield from of.args[1]
    for arg in of.args:
        if isinstance(arg, Node):
            yield from names_in(arg)


def walk(of: Tree) -> Iterator[Tree]:
    """A tree's nodes and leaves."""
    left = [of]
    while left:
        at = left.pop()
        yield at
        if isinstance(at, tuple):
            left += at[2:]


def leaf_ends(of: Tree) -> tuple[int, int]:
    """Least and greatest leaf."""
    leaves = [at for at in walk(of) if isinstance(at, int)]
    return min(leaves), max(leaves)


def _leaves(of: Tree, x: np.ndarray) -> np.ndarray:
    out = np.empty(len(x), np.int64)
    left = [(of, np.arange(len(x)))]
    while left:
        at, rows = left.pop()
        if isinstance(at, int):
            out[rows] = at
        elif len(rows):
            below = x[rows, at[0]] <= at[1]
            left += [(at[2], rows[below]), (at[3], rows[~below])]
    return out

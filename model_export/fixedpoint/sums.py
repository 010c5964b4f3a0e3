"""Nested sums of words as statements: what the device's `polynomial` does in loops, written out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from palpate.fixedpoint import ir
from palpate.fixedpoint.form import Form
from palpate.fixedpoint.ir import Code, Node, var
from palpate.fixedpoint.nested import Run, Step, Term
from palpate.fixedpoint.word_pairs import Words

_DEPTHS = "tvwrs"
_LONGEST = 40  # products in one statement with both words


def standardised(code: Code, held: Node, centre: int, shift: int, factor: int, u: str) -> None:
    """`u`: a feature within +-1 in Q28, of one that is held to its box (`firmware_py.unpack.scaling`)."""
    up = -shift
    v = code.let("v", held - centre)
    if 0 <= up < 14 and factor << up < 1 << 29:  # the shift up goes into constants
        most = (1 << 14 - up) - 1
        code.let(u, (v >> 14 - up) * factor + ((v & most) * (factor << up) >> 14))
    else:
        v = code.let("v", v >> shift)
        code.let(u, (v >> 14) * factor + ((v & 16383) * factor >> 14))


def keep_bits(code: Code, u: Node, name: str, form: Form) -> None:
    """The bits of an input that high words meet, p, and low words, q."""
    for letter, bits in (("p", form.part), ("q", form.high)):
        code.let(f"{letter}{name}", (u + (1 << 27 - bits)) >> 28 - bits)


def keep_halves(code: Code, u: Node, name: str) -> None:
    """Upper and lower half of an input that a branch is multiplied with."""
    code.let(f"a{name}", u >> 14)
    code.let(f"b{name}", u & 16383)


def branching(steps: Sequence[Step]) -> set[int]:
    """The inputs that branches are multiplied with."""
    return {step.branch[-1] for step in steps if not isinstance(step, Run)}


@dataclass(frozen=True)
class Sums:
    """Sums in one form over inputs whose bits are kept.

    Attributes
    ----------
    code : ir.Code
        To append to.
    form : Form
    words : list of Words
        Of each sum.
    names : list of str
        Of each input, in the names of its bits.
    labels : list of str
        Of each input, in words.
    titles : list of str
        Of each sum.
    """

    code: Code
    form: Form
    words: Sequence[Words]
    names: Sequence[str]
    labels: Sequence[str]
    titles: Sequence[str]

    def raw(self, j: int) -> Node:
        """Statements of sum j, before its shift and intercept."""
        code, words, form, note = self.code, self.words[j], self.form, f"{self.titles[j]}: "
        at = 0
        begun: set[str] = set()
        for step in form.steps:
            target = self._depth(len(step.branch))
            if isinstance(step, Run):
                k = slice(at, at + len(step.features))
                at = k.stop
                high = ir.dot(words.high[k].tolist(), [f"p{self.names[i]}" for i in step.features])
                low = ir.dot(words.low[k].tolist(), [f"q{self.names[i]}" for i in step.features])
                if target in begun:
                    h = self._long("h", high, low, note + self._place(step))
                    code.let(target, var(target) + (h >> form.downs[j]))
                else:
                    self._long(target, high, low, note + self._place(step))
                    if form.downs[j]:
                        code.let(target, var(target) >> form.downs[j])
                begun.add(target)
            else:
                own = form.own(j, words, at)
                at += 1
                value = var(target) + own if target in begun else own
                code.let(target, value, note + self._product(step.branch))
                name = self.names[step.branch[-1]]
                h, product = ir.mul(target, f"a{name}", f"b{name}")
                code.let("h", h)
                outer = self._depth(len(step.branch) - 1)
                code.let(outer, var(outer) + product if outer in begun else product)
                begun.discard(target)
                begun.add(outer)
        return var("t")

    def _long(self, name: str, high: Node, low: Node, note: str) -> Node:
        """A run's two sums."""
        let, down = self.code.let, self.form.low_sum_shift
        if not low.args[0]:
            return let(name, high, note)
        if not high.args[0]:
            return let(name, low >> down, note)
        if len(high.args[0]) + len(low.args[0]) > _LONGEST:
            let(name, high, note)
            g = let("g", low, note)
            return let(name, var(name) + (g >> down))
        return let(name, high + (low >> down), note)

    @staticmethod
    def _depth(n: int) -> str:
        return _DEPTHS[n] if n < len(_DEPTHS) else f"{_DEPTHS[-1]}{n}"

    def _product(self, branch: Term) -> str:
        return " * ".join(self.labels[i] for i in branch)

    def _place(self, run: Run) -> str:
        inner = ", ".join(self.labels[i] for i in run.features[:8])
        inner += ", .." if len(run.features) > 8 else ""
        return f"{self._product(run.branch)} * ({inner})" if run.branch else f"({inner})"

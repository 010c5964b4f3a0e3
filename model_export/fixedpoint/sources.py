"""A program as source without dependencies: Python for any MicroPython, C99 with 32-bit integers alone."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from typing import Any

from firmware_py import scales
from palpate.fixedpoint import device
from palpate.fixedpoint.ir import Code, Let, Node, Tree

_WIDE = 118  # columns
_LONGEST = 60  # products in one expression
_TIGHTER = {"+": 1, "-": 1, "dot": 1, "*": 2}
_INFIX = {"+", "-", "*", ">>", "<<", "&"}


def long_dots(code: Code) -> Iterator[Let]:
    """The statements, those of one very long sum cut into several."""
    for let in code.lets:
        if let.value.op == "dot" and len(let.value.args[0]) > _LONGEST:
            c, names = let.value.args
            for at in range(0, len(c), _LONGEST):
                part = Node("dot", c[at : at + _LONGEST], names[at : at + _LONGEST])
                yield Let(let.name, part if at == 0 else Node("+", Node("var", let.name), part), let.note)
        else:
            yield let


def _wrapped(text: str, indent: str, more: str) -> list[str]:
    """A long statement in lines that break at blanks."""
    lines = [indent]
    for word in text.split(" "):
        if len(lines[-1]) + len(word) > _WIDE and lines[-1].strip():
            lines.append(indent + more)
        lines[-1] += word + " "
    return [line.rstrip() for line in lines]


class Writer:
    """Expressions of one language.

    Parameters
    ----------
    choose : what writes "x where a < b, else y"
    c : whether it is C, where a shift of a negative number to the left is not defined
    """

    def __init__(self, choose: Callable[[str, str, str, str], str], c: bool) -> None:
        self.choose, self.c = choose, c

    def text(self, of: Node) -> str:
        """An expression."""
        match of.op:
            case "number" | "var":
                return str(of.args[0])
            case "dot":
                return self._dot(*of.args)
            case "<<" if self.c:
                return f"{self._inner(of.args[0], 2)} * {1 << of.args[1]}"
            case "clip":
                v, lo, hi = self.text(of.args[0]), of.args[1], of.args[2]
                return self.choose(v, str(lo), str(lo), self.choose(str(hi), v, str(hi), v))
            case "pick":
                return self.choose(*(self._inner(a, 3) for a in of.args))
            case "exp":
                return f"palpate_exp({self.text(of.args[0])}, {of.args[1]})"
            case "lookup":
                k, size = of.args[1], f"FIRST{of.args[1]}_SIZE, " if self.c else ""
                return f"palpate_lookup({self.text(of.args[0])}, FIRST{k}, {size}ROWS{k})"
            case "tree":
                return f"palpate_tree{of.args[0]}(x)"
        a, b = of.args
        tight = _TIGHTER.get(of.op, 0)
        right = self._inner(b, tight + 1) if isinstance(b, Node) else str(b)
        return f"{self._inner(a, tight if tight else 3)} {of.op} {right}"

    def _inner(self, of: Node, tight: int) -> str:
        """An operand: in parentheses unless it holds together as tightly as that."""
        loose = of.op in _INFIX or of.op in ("dot", "clip", "pick")
        text = self.text(of)
        own = 2 if self.c and of.op == "<<" else _TIGHTER.get(of.op, 0)
        if of.op == "dot" and len(of.args[0]) <= 1:
            own, loose = 2, bool(of.args[0])
        if of.op == "number" and of.args[0] < 0:
            return f"({text})"
        return f"({text})" if loose and own < tight else text

    def _dot(self, coefficients: tuple[int, ...], names: tuple[str, ...]) -> str:
        words: list[str] = []
        for c, name in zip(coefficients, names):
            sign = ("- " if c < 0 else "+ ") if words else ""
            words.append(f"{sign}{abs(c) if words else c} * {name}")
        return " ".join(words) or "0"


def _choose_python(a: str, b: str, below: str, above: str) -> str:
    return f"{below} if {a} < {b} else {above}"


def _choose_c(a: str, b: str, below: str, above: str) -> str:
    return f"{a} < {b} ? {below} : {above}"


def _numbers(values: Any, indent: str) -> str:
    lines = _wrapped(", ".join(map(str, values)) + ",", indent, "")
    return "\n".join(lines)


def _functions(code: Code) -> set[str]:
    """Which of the functions the program needs."""
    found = set()
    left = [let.value for let in code.lets]
    while left:
        at = left.pop()
        found.add(at.op)
        left += [arg for arg in at.args if isinstance(arg, Node)]
    return found


def python_body(code: Code) -> str:
    """The statements of a function of x and out, indented by four."""
    writer = Writer(_choose_python, c=False)
    lines = ["    powers = POWERS"] if "exp" in _functions(code) else []
    for let in _noted(code, lines, "    # {}"):
        if let.value.op == "exp":
            what, s = let.value.args
            lines += [line.format(v=writer.text(what), s=s, name=let.name) for line in _PYTHON_EXP]
            continue
        text = f"{let.name} = {writer.text(let.value)}"
        if len(text) > _WIDE - 4:
            text = f"{let.name} = ({writer.text(let.value)})"
        lines += _wrapped(text, "    ", "    ")
    return "\n".join(lines) + "\n"


def _noted(code: Code, lines: list[str], comment: str) -> Iterator[Let]:
    """The statements; where one has a note that the one before had not, it goes into the lines first."""
    said = ""
    for let in long_dots(code):
        if let.note and let.note != said:
            lines += _wrapped(comment.format(let.note), "", "    # " if "#" in comment else "       ")
            said = let.note
        yield let


def python_helpers(code: Code) -> str:
    """What stands before it: tables, functions, trees."""
    needed, parts = _functions(code), []
    if "exp" in needed:
        parts.append(f"POWERS = (\n{_numbers(scales.POWERS, '    ')}\n)\n\n\n")
    if "lookup" in needed:
        text = inspect.getsource(device.lookup).replace("def lookup(", "def palpate_lookup(")
        parts.append(text.replace("  # type: ignore[no-untyped-def]", "") + "\n\n")
    for k, table in enumerate(code.tables):
        parts.append(f"FIRST{k} = (\n{_numbers(table.first, '    ')}\n)\n")
        parts.append(f"ROWS{k} = (\n{_numbers(table.rows, '    ')}\n)\n")
    if code.tables:
        parts.append("\n\n")
    for k, of in enumerate(code.trees):
        lines = [f"def palpate_tree{k}(x):", *_tree(of, 1, "if x[{}] <= {}:", "return {}")]
        parts.append("\n".join(lines) + "\n\n\n")
    return "".join(parts)


def c_body(code: Code) -> str:
    """The statements of a function of x and out."""
    writer = Writer(_choose_c, c=True)
    names = sorted({let.name for let in code.lets if not let.name.startswith("out[")})
    lines = _wrapped(f"int32_t {', '.join(names)};", "    ", "    ") if names else []
    for let in _noted(code, lines, "    /* {} */"):
        lines += _wrapped(f"{let.name} = {writer.text(let.value)};", "    ", "    ")
    return "\n".join(lines) + "\n"


_PYTHON_EXP = (  # `scales.exp` written out: a call costs more than half of it
    "    ew = {v}; ek = ew // 181704; ew -= ek * 181704 + (ek * 3 >> 3); em = powers[ek & 63]; eh = ew >> 3",
    "    ew += eh * eh >> 19; em += (em >> 10) * (ew >> 3) >> 11; ek = {s} - (ek >> 6)",
    "    {name} = (em + (1 << ek - 1) >> ek if ek < 31 else 0) if ek > 0 else em << -ek if ek > -5 "
    "else 1073741823",
)
_C_TREE = ("if (x[{}] <= {}) {{", "return {};", "}")
_C_EXP = """static int32_t palpate_exp(int32_t v, int s)
{
    int32_t k = v / 181704, m, w;
    if (v % 181704 < 0) k--;
    v -= k * 181704 + (k * 3 >> 3);
    m = POWERS[k & 63];
    w = v >> 3;
    v += w * w >> 19;
    m += (m >> 10) * (v >> 3) >> 11;
    s -= k >> 6;
    if (s > 0) return s < 31 ? (m + ((int32_t)1 << (s - 1))) >> s : 0;
    return s > -5 ? m * (1 << -s) : 0x3FFFFFFF;
}

"""
_C_LOOKUP = """static int32_t palpate_lookup(int32_t x, const int32_t *first, int k, const int32_t *rows)
{
    int i = 0;
    int32_t a, h, v;
    while (k - i > 1) {
        int half = (i + k) >> 1;
        if (x < first[half]) k = half; else i = half;
    }
    x -= first[i];
    rows += 5 * i;
    x = rows[0] >= 0 ? x * ((int32_t)1 << rows[0]) : x >> -rows[0];
    a = x >> 14;
    x &= 16383;
    v = rows[4];
    for (k = 3; k > 0; k--) {
        h = v >> 14;
        v = rows[k] + a * h + ((a * (v & 16383) + x * h) >> 14);
    }
    return v;
}

"""


def c_helpers(code: Code) -> str:
    """What stands before it."""
    needed, parts = _functions(code), []
    if "exp" in needed:
        parts.append(f"static const int32_t POWERS[64] = {{\n{_numbers(scales.POWERS, '    ')}\n}};\n\n")
        parts.append(_C_EXP)
    if "lookup" in needed:
        parts.append(_C_LOOKUP)
    for k, table in enumerate(code.tables):
        parts.append(f"enum {{ FIRST{k}_SIZE = {len(table.first)} }};\n")
        for name, values in (("FIRST", table.first), ("ROWS", table.rows)):
            parts.append(f"static const int32_t {name}{k}[] = {{\n{_numbers(values, '    ')}\n}};\n")
    for k, of in enumerate(code.trees):
        lines = [f"static int32_t palpate_tree{k}(const int32_t *x)", "{", *_tree(of, 1, *_C_TREE), "}"]
        parts.append("\n".join(lines) + "\n\n")
    return "".join(parts)


def _tree(of: Tree, deep: int, test: str, leaf: str, end: str = "") -> Iterator[str]:
    """A tree as nested conditions: how one is written, a leaf, and what ends a condition's block."""
    pad = " " * deep
    while isinstance(of, tuple):
        feature, threshold, below, above = of
        yield pad + test.format(feature, threshold)
        yield from _tree(below, deep + 1, test, leaf, end)
        if end:
            yield pad + end
        of = above
    yield pad + leaf.format(of)

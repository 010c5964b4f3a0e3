"""The firmware's own names exchanged for names that MicroPython holds in its flash anyhow.

    borrowed({"probe.py": "...", "bins.py": "..."}, kept)

Each name that a module brings with it takes some twenty bytes of a board's memory, for ever; eight hundred of
them took more than the outbox. MicroPython's port brings a thousand of its own, which cost nothing: a name of
the firmware's becomes one of those that the firmware does not use, everywhere the same one. Modules keep
their names, and so does what a program at the prompt may ask for (`kept`). The integers stay.
"""

from __future__ import annotations

import ast
import builtins
import keyword
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

from palpate.sim.probe.rp2040.rom_names import NAMES

_SPECIAL = {"self", "const", "native", "viper", "ptr", "bytecode", "send", "throw", "close", "micropython"}
"""Names that the interpreter, its compiler or ours give a meaning."""


def borrowed(sources: Mapping[str, str], kept: Iterable[str] = ()) -> dict[str, str]:
    """The same modules under borrowed names. Parameters: source by path inside firmware_py; names to keep."""
    trees = {path: ast.parse(text) for path, text in sources.items()}
    modules = {part for path in trees for part in path.removesuffix(".py").split("/")}
    own: Counter[str] = Counter()
    seen = set()
    for tree in trees.values():
        local = _locals(tree)
        for node in ast.walk(tree):
            seen |= set(_words(node))
            own.update(name for name in _bound(node) if (id(node), name) not in local)
        kept = {*kept, *_assembler(tree)}
    known = set(NAMES)
    free = [name for name in NAMES if _may_be_lent(name) and name not in seen]
    wanted = [
        name
        for name, _ in sorted(own.items(), key=lambda item: (-item[1], item[0]))
        if name not in known | modules | set(kept) and not name.startswith("__")
    ]
    lent = dict(zip(wanted, free, strict=False))
    for tree in trees.values():
        _Rename(lent).visit(tree)
    return {path: ast.unparse(tree) for path, tree in trees.items()}


def _may_be_lent(name: str) -> bool:
    if name.startswith("_") or name in _SPECIAL or hasattr(builtins, name):
        return False
    return not keyword.iskeyword(name) and not keyword.issoftkeyword(name)


def _assembler(tree: ast.Module) -> set[str]:
    """Instructions and registers: every name in a function of inline assembler."""
    found: set[str] = set()
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef) and any(
            "asm_thumb" in _words(decorator) for decorator in function.decorator_list
        ):
            found.update(word for node in ast.walk(function) for word in _words(node) if node is not function)
    return found


def _bound(node: ast.AST) -> Iterator[str]:
    """The names that a node gives to something, and that a compiled module carries with it."""
    if isinstance(node, (ast.Name, ast.Attribute)) and not isinstance(node.ctx, ast.Load):
        yield node.id if isinstance(node, ast.Name) else node.attr
    elif isinstance(node, ast.arg):
        yield node.arg
    elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
        yield node.name
    elif isinstance(node, ast.alias) and node.asname:
        yield node.asname


def _locals(tree: ast.Module) -> set[tuple[int, str]]:
    """Where functions give names to their own variables, which a compiled module does not carry."""
    found = set()
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            shared = {
                name for node in ast.walk(function) if isinstance(node, ast.Global) for name in node.names
            }
            for node in ast.walk(function):
                if isinstance(node, ast.Name) and node.id not in shared:
                    found.add((id(node), node.id))
    return found


def _words(node: ast.AST) -> Iterator[str]:
    """Every name and word that a node mentions."""
    for _, value in ast.iter_fields(node):
        for word in value if isinstance(value, list) else [value]:
            if isinstance(word, str):
                yield from word.replace(".", " ").split()


class _Rename(ast.NodeTransformer):
    def __init__(self, lent: Mapping[str, str]) -> None:
        self._lent = lent

    def generic_visit(self, node: ast.AST) -> ast.AST:
        for field in ("id", "attr", "arg", "name", "asname"):
            value = getattr(node, field, None)
            if isinstance(value, str):
                setattr(node, field, self._lent.get(value, value))
        if isinstance(node, (ast.Global, ast.Nonlocal)):
            node.names = [self._lent.get(name, name) for name in node.names]
        return super().generic_visit(node)

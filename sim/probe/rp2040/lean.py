"""The firmware's source without what a board never reads, which is names, tables and sentences for people.

    lean({"status.py": "...", "probe.py": "..."}, main)

Numbers that a module only states (`status.OK`, `FRAME_HEAD + geometry.FRAME_BYTES`) stand where they are
used. What is then used nowhere goes: constants, sentences, functions and methods, imports. A name counts as
used where anything of that name is, in any module, so nothing goes that could be meant. The integers stay.
"""

from __future__ import annotations

import ast
import operator
from collections import Counter
from collections.abc import Callable, Iterator, Mapping

_PACKAGE = "firmware_py"
_FOLDED: dict[type[ast.operator], Callable[[int, int], int]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.FloorDiv: operator.floordiv,
    ast.LShift: operator.lshift,
    ast.RShift: operator.rshift,
    ast.BitAnd: operator.and_,
    ast.BitOr: operator.or_,
}


def lean(sources: Mapping[str, str], main: str) -> dict[str, str]:
    """The same modules, leaner; those that nothing imports any more are not among them.

    Parameters: source by path inside firmware_py, and the program that imports the first of them.
    """
    trees = {path: ast.parse(text) for path, text in sources.items()}
    start = ast.parse(main)
    for tree in trees.values():
        _Annotations().visit(tree)
    facts = {path: _Facts(tree) for path, tree in trees.items()}
    changed = True
    while changed:
        numbers = {path: fact.numbers() for path, fact in facts.items()}
        for fact in facts.values():
            for path, name in fact.set_outside:
                numbers.get(path, {}).pop(name, None)
        folds = [_Fold(path, fact, numbers) for path, fact in facts.items()]
        for fold in folds:
            fold.visit(fold.tree)
        used = _used([*trees.values(), start])
        dropped = [_drop(tree, used) for tree in trees.values()]
        facts = {path: _Facts(tree) for path, tree in trees.items()}
        reached = _reached(facts, _Facts(start))
        changed = any(fold.changed for fold in folds) or any(dropped) or reached != set(trees)
        trees = {path: tree for path, tree in trees.items() if path in reached}
        facts = {path: facts[path] for path in trees}
    return {path: ast.unparse(ast.fix_missing_locations(tree)) for path, tree in trees.items()}


def _value(node: ast.AST) -> int | None:
    """The number that an expression of numbers is."""
    if isinstance(node, ast.Constant) and type(node.value) is int:
        return node.value
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        value = _value(node.operand)
        return None if value is None else -value
    if isinstance(node, ast.BinOp) and type(node.op) in _FOLDED:
        left, right = _value(node.left), _value(node.right)
        if left is not None and right is not None:
            return _FOLDED[type(node.op)](left, right)
    return None


class _Facts:
    """What one walk over a module finds.

    Attributes: tree; modules: alias and path of every module of the firmware that is imported, in functions
    too; bound: how often each name is bound anywhere (assigned, a parameter, imported, defined); set_outside:
    path and name of what this module assigns to in others.
    """

    def __init__(self, tree: ast.Module) -> None:
        self.tree = tree
        self.modules: list[tuple[str, str]] = []
        self.bound: Counter[str] = Counter()
        stored: list[tuple[str, str]] = []
        for node in ast.walk(tree):
            if isinstance(node, ast.Name):
                self.bound[node.id] += not isinstance(node.ctx, ast.Load)
            elif isinstance(node, ast.Attribute):
                if isinstance(node.value, ast.Name) and not isinstance(node.ctx, ast.Load):
                    stored.append((node.value.id, node.attr))
            elif isinstance(node, ast.arg):
                self.bound[node.arg] += 1
            elif isinstance(node, ast.alias):
                self.bound[(node.asname or node.name).split(".")[0]] += 1
            elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                self.bound[node.name] += 1
            elif isinstance(node, ast.Global):
                self.bound.update(2 * node.names)
            if isinstance(node, ast.ImportFrom):
                self.modules += _imported(node)
        paths = dict(self.modules)
        self.set_outside = [(paths[alias], name) for alias, name in stored if alias in paths]

    def numbers(self) -> dict[str, int]:
        """What the module states once and never changes."""
        found = {}
        for node in self.tree.body:
            if (
                isinstance(node, ast.Assign)
                and len(node.targets) == 1
                and isinstance(node.targets[0], ast.Name)
            ):
                name, value = node.targets[0].id, _value(node.value)
                if value is not None and self.bound[name] == 1:
                    found[name] = value
        return found


def _imported(node: ast.ImportFrom) -> Iterator[tuple[str, str]]:
    """Alias and path of the firmware's modules among what a statement imports."""
    if (node.module or "").split(".")[0] == _PACKAGE:
        folder = (node.module or "").removeprefix(_PACKAGE).replace(".", "/").lstrip("/")
        for alias in node.names:
            path = f"{folder}/{alias.name}.py" if folder else f"{alias.name}.py"
            yield alias.asname or alias.name, path


class _Annotations(ast.NodeTransformer):
    """What only a type checker reads goes; viper's own types, which are not in quotes, stay."""

    def visit_If(self, node: ast.If) -> ast.AST | list[ast.stmt]:
        self.generic_visit(node)
        return node.orelse if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING" else node


class _Fold(ast.NodeTransformer):
    """Numbers in their names' place."""

    def __init__(self, path: str, facts: _Facts, numbers: Mapping[str, Mapping[str, int]]) -> None:
        self.tree = facts.tree
        self.changed = False
        self._own = numbers[path]
        times = Counter(alias for alias, _ in facts.modules)
        self._others = {
            alias: numbers[where]
            for alias, where in facts.modules
            if where in numbers and facts.bound[alias] == times[alias]
        }

    def visit_Name(self, node: ast.Name) -> ast.AST:
        if isinstance(node.ctx, ast.Load) and node.id in self._own:
            self.changed = True
            return ast.Constant(self._own[node.id])
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if isinstance(node.ctx, ast.Load) and isinstance(node.value, ast.Name):
            value = self._others.get(node.value.id, {}).get(node.attr)
            if value is not None:
                self.changed = True
                return ast.Constant(value)
        self.generic_visit(node)
        return node


def _used(trees: list[ast.Module]) -> Counter[str]:
    """How often each name is read anywhere, as a name, an attribute, a keyword, or a word in quotes."""
    used: Counter[str] = Counter()
    for tree in trees:
        for node in ast.walk(tree):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
                used[node.id] += 1
            elif isinstance(node, ast.Attribute):
                used[node.attr] += 1
            elif isinstance(node, ast.keyword) and node.arg:
                used[node.arg] += 1
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                used[node.value] += 1
    return used


def _plain(node: ast.AST) -> bool:
    """True of an expression that does nothing but be."""
    return not any(
        isinstance(part, (ast.Call, ast.Await, ast.Yield, ast.NamedExpr)) for part in ast.walk(node)
    )


def _drop(tree: ast.Module, used: Mapping[str, int]) -> bool:
    """Take away what nobody reads; whether there was anything."""

    def needed(node: ast.stmt) -> bool:
        if isinstance(node, ast.FunctionDef):
            dunder = node.name.startswith("__")
            return dunder or bool(used[node.name])
        if isinstance(node, ast.ClassDef):
            return bool(used[node.name])
        if isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            return bool(used[node.targets[0].id]) or not _plain(node.value)
        return True

    before = len(tree.body)
    tree.body = [node for node in tree.body if needed(node)]
    changed = len(tree.body) < before
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            kept = [m for m in node.body if not isinstance(m, ast.FunctionDef) or needed(m)]
            changed = changed or len(kept) < len(node.body)
            node.body = kept or [ast.Pass()]
    here = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    for node in list(tree.body):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == _PACKAGE:
            names = [a for a in node.names if (a.asname or a.name) in here]
            changed = changed or len(names) < len(node.names)
            node.names = names
            if not names:
                tree.body.remove(node)
    return changed


def _reached(facts: Mapping[str, _Facts], start: _Facts) -> set[str]:
    """The modules that the program imports, and those that they do."""
    found: set[str] = {path for path in facts if path.endswith("__init__.py")}
    waiting = [path for _, path in start.modules]
    while waiting:
        path = waiting.pop()
        if path in facts and path not in found:
            found.add(path)
            waiting += [where for _, where in facts[path].modules]
    return found

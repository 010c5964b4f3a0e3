"""The firmware's source without what a board never reads, which is names, tables and sentences for people.

    lean({"status.py": "...", "probe.py": "..."}, main)

Numbers that a module only states (`status.OK`, `FRAME_HEAD + geometry.FRAME_BYTES`) stand where they are
used, and tables that it works out from others (`messages.FORMATS`) are worked out here. What is then used
nowhere goes: constants, sentences, functions and methods, imports. A name behind a module's is that module's;
any other counts as used where anything of that name is, so nothing goes that could be meant. The integers
stay.
"""

from __future__ import annotations

import ast
import importlib
import operator
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from typing import Any

_PACKAGE = "firmware_py"
_PURE = {"bytes", "dict", "len", "list", "max", "min", "range", "sorted", "sum", "tuple"}
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
    for path, tree in trees.items():
        _Annotations().visit(tree)
        _leave_docstrings(tree)
        _work_out(path, tree)
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
        used = _used({**facts, "": _Facts(start)})
        dropped = [_drop(tree, used[path] + used["*"]) for path, tree in trees.items()]
        facts = {path: _Facts(tree) for path, tree in trees.items()}
        reached = _reached(facts, _Facts(start))
        changed = any(fold.changed for fold in folds) or any(dropped) or reached != set(trees)
        trees = {path: tree for path, tree in trees.items() if path in reached}
        facts = {path: facts[path] for path in trees}
    return {path: ast.unparse(ast.fix_missing_locations(tree)) for path, tree in trees.items()}


def reached(sources: Mapping[str, str], main: str) -> list[str]:
    """Of the same sources, those that the program needs, its imports inside functions among them."""
    facts = {path: _Facts(ast.parse(text)) for path, text in sources.items()}
    return sorted(_reached(facts, _Facts(ast.parse(main))))


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


def _module(path: str) -> Any:
    """A module of the firmware as it runs here; None for one that only a board can run."""
    try:
        return importlib.import_module(f"{_PACKAGE}.{path.removesuffix('.py').replace('/', '.')}")
    except ImportError:
        return None


def _literal(value: object) -> ast.expr | None:
    """An expression for a number, text, or a table of such."""
    if isinstance(value, (tuple, dict)) or type(value) in (int, str, bytes):
        try:
            return ast.parse(repr(value) if ast.literal_eval(repr(value)) == value else "", mode="eval").body
        except (SyntaxError, ValueError):
            pass
    return None


def _work_out(path: str, tree: ast.Module) -> None:
    """Put what a module works out of constants while it is loaded in as constants."""
    if path.startswith("boards/") or (module := _module(path)) is None:
        return
    facts = _Facts(tree)
    bound = facts.bound
    made = {alias for alias, _ in facts.modules} | _PURE
    made |= {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    body: list[ast.stmt] = []
    for node in tree.body:
        body.append(node)
        if not isinstance(node, ast.Assign) or _value(node.value) is not None:
            continue
        inner = {part.id for part in ast.walk(node.value) if isinstance(part, ast.Name)}
        inside = {name for part in ast.walk(node.value) for name in _targets(part)}
        (target,) = node.targets
        names = _targets(target)
        if inner - inside <= made and names and all(bound[name] == 1 for name in names):
            values = [_literal(getattr(module, name, None)) for name in names]
            if all(value is not None for value in values):
                body[-1:] = [
                    ast.Assign([ast.Name(name, ast.Store())], value)
                    for name, value in zip(names, values, strict=True)
                    if value is not None
                ]
        if all(bound[name] == 1 for name in names):
            made.update(names)
    tree.body = body


def _targets(node: ast.AST) -> list[str]:
    """The names that an assignment's target or a comprehension's loop binds."""
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        return [node.id]
    if isinstance(node, ast.Tuple) and isinstance(node.ctx, ast.Store):
        return [name for part in node.elts for name in _targets(part)]
    return []


class _Annotations(ast.NodeTransformer):
    """What only a type checker reads goes; viper's own types, which are not in quotes, stay."""

    def visit_If(self, node: ast.If) -> ast.AST | list[ast.stmt]:
        self.generic_visit(node)
        return node.orelse if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING" else node


def _leave_docstrings(tree: ast.Module) -> None:
    """A compiler drops them, but their words would count as names that are in use (names.py)."""
    for node in ast.walk(tree):
        if (
            isinstance(node, (ast.Module, ast.FunctionDef, ast.ClassDef))
            and ast.get_docstring(node) is not None
        ):
            node.body = node.body[1:] or ([] if isinstance(node, ast.Module) else [ast.Pass()])


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
        self._paths = {alias: where for alias, where in facts.modules if alias in self._others}

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

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        """`messages.TYPE["log"]`"""
        self.generic_visit(node)
        table, key = node.value, node.slice
        if (
            isinstance(node.ctx, ast.Load)
            and isinstance(table, ast.Attribute)
            and isinstance(table.value, ast.Name)
            and isinstance(key, ast.Constant)
            and table.value.id in self._paths
        ):
            values = getattr(_module(self._paths[table.value.id]), table.attr, None)
            if isinstance(values, dict) and type(values.get(key.value)) is int:
                self.changed = True
                return ast.Constant(values[key.value])
        return node


def _used(facts: Mapping[str, _Facts]) -> defaultdict[str, Counter[str]]:
    """How often each module's names are read; under "*" attributes of who knows what, and words in quotes."""
    used: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for path, fact in facts.items():
        times = Counter(alias for alias, _ in fact.modules)
        paths = {alias: where for alias, where in fact.modules if fact.bound[alias] == times[alias]}
        for node in ast.walk(fact.tree):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
                used[path][node.id] += 1
            elif isinstance(node, ast.Attribute):
                owner = paths.get(node.value.id, "*") if isinstance(node.value, ast.Name) else "*"
                used[owner][node.attr] += 1
            elif isinstance(node, ast.keyword) and node.arg:
                used["*"][node.arg] += 1
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                used["*"][node.value] += 1
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

"""Takes functions of firmware_py out of their modules, for an interpreter too small to compile a module.

Each function that is asked for, and each that it calls, becomes one piece of text; constants are put in as
numbers, names are shortened, comments stay behind. The statements are the firmware's own.
"""

import ast
import builtins
import importlib
import inspect
import itertools
import string
from collections.abc import Iterator
from types import FunctionType, ModuleType


def _short_names() -> Iterator[str]:
    letters = [c for c in string.ascii_letters if c not in "gOK"]
    yield from letters
    yield from (
        a + b for a in letters for b in letters if not hasattr(builtins, a + b) and a + b not in _KEYWORDS
    )


_KEYWORDS = {"as", "if", "in", "is", "or"}
_POOL = list(itertools.islice(_short_names(), 400))


class Flattener:
    """Collects functions.

    `names`: "module.function" -> short name; `pieces`: short name -> its definition, which finds the
    others as attributes of a module `g`; `tables`: short name -> the numbers of a constant tuple.
    """

    def __init__(self) -> None:
        self.names: dict[str, str] = {}
        self.pieces: dict[str, str] = {}
        self.tables: dict[str, tuple[int, ...]] = {}

    def add(self, full_name: str) -> str:
        """Add firmware_py.<full_name> and what it needs; return its short name."""
        if full_name in self.names:
            return self.names[full_name]
        module_name, _, name = full_name.rpartition(".")
        module = importlib.import_module(f"firmware_py.{module_name}")
        thing = getattr(module, name)
        if isinstance(thing, FunctionType):
            home = thing.__module__.removeprefix("firmware_py.")
            if (home, thing.__name__) != (module_name, name):  # an alias of another module's function
                short = self.add(f"{home}.{thing.__name__}")
                self.names[full_name] = short
                return short
            text = self._function(module, thing)
            short = f"_{len(self.pieces) + len(self.tables)}"
            self.pieces[short] = text.replace("def f(", f"def {short}(", 1)
        else:
            short = f"_{len(self.pieces) + len(self.tables)}"
            self.tables[short] = tuple(thing)
        self.names[full_name] = short
        return short

    def _function(self, module: ModuleType, function: FunctionType) -> str:
        tree = ast.parse(inspect.getsource(function))
        definition = tree.body[0]
        assert isinstance(definition, ast.FunctionDef)
        if ast.get_docstring(definition) is not None:
            del definition.body[0]
        definition.name = "f"
        _Rename(self, module, definition).visit(definition)
        ast.fix_missing_locations(tree)
        lines = []
        for line in ast.unparse(tree).splitlines():
            body = line.lstrip(" ")
            lines.append(" " * ((len(line) - len(body)) // 4) + body)
        return "\n".join(line for line in lines if line)


class _Rename(ast.NodeTransformer):
    """Locals to the shared pool, module constants to numbers, functions to their short names."""

    def __init__(self, flat: Flattener, module: ModuleType, function: ast.FunctionDef) -> None:
        self._flat = flat
        self._module = module
        local = [a.arg for a in function.args.args]
        local += [
            n.id for n in ast.walk(function) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
        ]
        self._local = {name: _POOL[i] for i, name in enumerate(dict.fromkeys(local))}

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.arg = self._local[node.arg]
        return node

    def _resolve(self, module: ModuleType, name: str) -> ast.expr:
        thing = getattr(module, name)
        if isinstance(thing, int):
            return ast.Constant(thing)
        home = module.__name__.removeprefix("firmware_py.")
        short = self._flat.add(f"{home}.{name}")
        return ast.Attribute(ast.Name("g", ast.Load()), short, ast.Load())

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self._local:
            return ast.Name(self._local[node.id], node.ctx)
        if hasattr(self._module, node.id):
            return self._resolve(self._module, node.id)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        if isinstance(node.value, ast.Name) and node.value.id not in self._local:
            owner = getattr(self._module, node.value.id, None)
            if isinstance(owner, ModuleType):
                return self._resolve(owner, node.attr)
        self.generic_visit(node)
        return node

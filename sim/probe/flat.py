"""Takes functions of firmware_py out of their modules, for an interpreter too small to compile a module.

Each function or class that is asked for, and each that it calls, becomes one piece of text; constants are put
in as numbers, names are shortened, comments stay behind. The statements are the firmware's own.
"""

import ast
import builtins
import importlib
import inspect
import itertools
import keyword
import string
from collections.abc import Iterable
from types import FunctionType, ModuleType

_LOCALS = 60  # how many names are set aside for the variables of functions
_FIRST = 20  # the shortest are left for what is called and given
_KEPT = {*dir(builtins), *keyword.kwlist, "array"}


def _made_up() -> Iterable[str]:
    yield from string.ascii_letters
    yield from (f"{a}{b}" for a in string.ascii_letters for b in string.ascii_letters)


class Flattener:
    """Collects functions and classes.

    names: to give away first, for example those that the interpreter knows anyhow.

    Attributes: `names`: "module.function" -> its name now; `pieces`: name -> its definition, which finds
    the others by their names; `tables`: name -> the numbers of a constant tuple.
    """

    def __init__(self, names: Iterable[str] = ()) -> None:
        self.names: dict[str, str] = {}
        self.pieces: dict[str, str] = {}
        self.tables: dict[str, tuple[int, ...]] = {}
        pool = (name for name in dict.fromkeys((*names, *_made_up())) if name not in _KEPT)
        first = list(itertools.islice(pool, _FIRST))
        self.locals = list(itertools.islice(pool, _LOCALS))
        self._globals = itertools.chain(first, pool)

    def fresh(self) -> str:
        """A name that nothing has yet."""
        return next(self._globals)

    def add(self, full_name: str) -> str:
        """Add firmware_py.<full_name> and what it needs; return its name."""
        if full_name in self.names:
            return self.names[full_name]
        module_name, _, name = full_name.rpartition(".")
        module = importlib.import_module(f"firmware_py.{module_name}")
        thing = getattr(module, name)
        if isinstance(thing, FunctionType | type):
            home = thing.__module__.removeprefix("firmware_py.")
            if (home, thing.__name__) != (module_name, name):  # an alias of another module's function
                self.names[full_name] = short = self.add(f"{home}.{thing.__name__}")
                return short
        self.names[full_name] = short = self.fresh()
        if isinstance(thing, FunctionType | type):
            self.pieces[short] = self._definition(module, thing, short)
        else:
            self.tables[short] = tuple(thing)
        return short

    def _definition(self, module: ModuleType, thing: FunctionType | type, short: str) -> str:
        tree = ast.parse(inspect.getsource(thing))
        definition = tree.body[0]
        assert isinstance(definition, ast.FunctionDef | ast.ClassDef)
        definition.name = short
        functions = [node for node in ast.walk(definition) if isinstance(node, ast.FunctionDef)]
        for node in (definition, *functions):
            if ast.get_docstring(node) is not None:
                del node.body[0]
        for node in functions:
            _Rename(self, module, node).visit(node)
        ast.fix_missing_locations(tree)
        lines = []
        for line in ast.unparse(tree).splitlines():
            body = line.lstrip(" ")
            lines.append(" " * ((len(line) - len(body)) // 4) + body)
        return "\n".join(line for line in lines if line) + "\n"


class _Rename(ast.NodeTransformer):
    """Locals to the shared pool, module constants to numbers, functions to their names now."""

    def __init__(self, flat: Flattener, module: ModuleType, function: ast.FunctionDef) -> None:
        self._flat = flat
        self._module = module
        local = [a.arg for a in function.args.args]
        local += [
            n.id for n in ast.walk(function) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
        ]
        self._local = {name: flat.locals[i] for i, name in enumerate(dict.fromkeys(local))}

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.arg = self._local[node.arg]
        return node

    def _resolve(self, module: ModuleType, name: str) -> ast.expr:
        thing = getattr(module, name)
        if isinstance(thing, int):
            return ast.Constant(thing)
        home = module.__name__.removeprefix("firmware_py.")
        return ast.Name(self._flat.add(f"{home}.{name}"), ast.Load())

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self._local:
            return ast.Name(self._local[node.id], node.ctx)
        if hasattr(self._module, node.id) and node.id != "array":
            return self._resolve(self._module, node.id)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        if isinstance(node.value, ast.Name) and node.value.id not in self._local:
            owner = getattr(self._module, node.value.id, None)
            if isinstance(owner, ModuleType):
                return self._resolve(owner, node.attr)
        self.generic_visit(node)
        return node

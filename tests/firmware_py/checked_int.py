"""Every intermediate number of the firmware watched: the same source, each arithmetic result checked.

A 32-bit port of MicroPython keeps integers of 31 bits in place; a larger one would be allocated, and in
viper or C it would wrap. So the firmware promises that nothing, not even half way through an expression,
leaves +-2^30.
"""

import ast
from array import array

from palpate.firmware_twin import twin

LIMIT = 1 << 30


class LeftTheRange(AssertionError):
    """An intermediate of 2^30 or more, and where."""


class Watch:
    """Checks every number; remembers the largest, and where it was."""

    def __init__(self):
        self.most = 0
        self.where = ""

    def __call__(self, value, where):
        if type(value) is int:
            size = value if value >= 0 else -value
            if size >= LIMIT:
                raise LeftTheRange(f"{where}: {value}")
            if size > self.most:
                self.most, self.where = size, where
        elif isinstance(value, float):
            raise LeftTheRange(f"{where}: a float, {value}")
        return value


class _Wrap(ast.NodeTransformer):
    """Puts each arithmetic result, and each constant, through the watch."""

    def __init__(self, name):
        self.name = name

    def _checked(self, node, at):
        where = ast.Constant(f"{self.name}.py:{at.lineno}")
        return ast.copy_location(ast.Call(ast.Name("_watch_", ast.Load()), [node, where], []), at)

    def visit_BinOp(self, node):
        self.generic_visit(node)
        return self._checked(node, node)

    def visit_UnaryOp(self, node):
        self.generic_visit(node)
        return self._checked(node, node)

    def visit_AugAssign(self, node):
        # x += y becomes x = watch(x + y); an index with a side effect would run twice, so there may be none
        self.generic_visit(node)
        target = node.target
        read = ast.parse(ast.unparse(target), mode="eval").body
        assert not any(_calls(n) for n in ast.walk(target))
        value = self._checked(ast.copy_location(ast.BinOp(read, node.op, node.value), node), node)
        return ast.copy_location(ast.Assign([target], value), node)


def _calls(node):
    return isinstance(node, ast.Call) and not (isinstance(node.func, ast.Name) and node.func.id == "_watch_")


def wrap(tree, name):
    """A module's syntax tree with every arithmetic result put through `_watch_`."""
    return _Wrap(name).visit(tree)


def load(stages=twin.STAGES):
    """The firmware's modules with every intermediate checked, and the watch that saw them."""
    watch = Watch()
    names = iter(stages)
    modules = twin.load(
        stages, label="checked", rewrite=lambda tree: _Wrap(next(names)).visit(tree), names={"_watch_": watch}
    )
    return modules, watch


def ints(values):
    """An array('i') of the values."""
    return array("i", [int(v) for v in values])

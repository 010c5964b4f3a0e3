"""The viper twin of the evaluator's loops, read as plain Python: it agrees.

tests/sim/probe/test_machine_code.py runs it as what it is, machine code.
"""

from __future__ import annotations

import ast
import sys
import types
from array import array
from pathlib import Path

import pytest

from firmware_py import constant, evaluator, polynomial
from firmware_py import features as firmware_features
from palpate.model_export.fixed_point import compiler
from tests.model_export import synthetic
from tests.model_export.test_micropython import rows

SOURCE = Path(evaluator.__file__).with_name("evaluator_viper.py")


class Pointer:
    """A viper pointer: words without a sign (or 32 bits with it) over an array; what is written wraps."""

    def __init__(self, buffer, size):
        self.bytes = memoryview(buffer).cast("B")
        self.size = size

    def __getitem__(self, i):
        raw = self.bytes[self.size * i : self.size * (i + 1)]
        return int.from_bytes(raw, sys.byteorder, signed=self.size == 4)

    def __setitem__(self, i, value):
        raw = (value & (1 << 8 * self.size) - 1).to_bytes(self.size, sys.byteorder)
        self.bytes[self.size * i : self.size * (i + 1)] = raw


POINTERS = {f"ptr{8 * n}": (lambda buffer, n=n: Pointer(buffer, n)) for n in (1, 2, 4)}


def viper(function):
    """Call with arguments turned into what the annotations say, as viper does."""
    casts = [POINTERS.get(kind, lambda v: v) for kind in function.kinds]

    def called(*arguments):
        return function(*(cast(v) for cast, v in zip(casts, arguments, strict=True)))

    return called


@pytest.fixture(scope="module")
def twin():
    tree = ast.parse(SOURCE.read_text())
    kinds = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            kinds[node.name] = [a.annotation.id if a.annotation else "" for a in node.args.args]
            node.decorator_list = []
            node.returns = None
            for a in node.args.args:
                a.annotation = None
    tree.body = [n for n in tree.body if not isinstance(n, ast.Import | ast.ImportFrom)]
    space: dict = dict(POINTERS) | {"constant": constant}
    exec(compile(ast.fix_missing_locations(tree), str(SOURCE), "exec"), space)
    found = {}
    for name, function in space.items():
        if isinstance(function, types.FunctionType) and name in kinds and name != "install":
            function.kinds = kinds[name]
            found[name] = viper(function)
    return found


def test_the_twin_names_functions_of_the_polynomials(twin):
    assert set(twin) == {"nested", "dot_high"}
    assert all(hasattr(polynomial, name) for name in twin)


@pytest.mark.parametrize(("kind", "degree"), [("thesis", 2), ("field", 2), ("field", 3)])
def test_the_same_integers_as_the_plain_loops(twin, monkeypatch, kind, degree):
    spec = synthetic.model(kind, degree)
    tables = compiler.compile_model(spec)
    vectors = rows(spec, 30)
    out = array("i", [0] * evaluator.OUT_SIZE)
    plain = [[tables.evaluate(array("i", row), out), *out] for row in vectors]
    for name, function in twin.items():
        monkeypatch.setattr(polynomial, name, function)
    assert [[tables.evaluate(array("i", row), out), *out] for row in vectors] == plain
    assert all(len(row) == firmware_features.COUNT for row in vectors)

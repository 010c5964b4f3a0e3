"""One program, the same integers: in numpy, on MicroPython as source and as bytecode, and in C."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import firmware_py
import palpate.fixedpoint
from palpate.fixedpoint import CompileError, from_sklearn
from tests.fixedpoint import pipelines, running

KINDS = (
    "least squares", "degree 5", "splines", "of counts", "logarithm of the target", "forest of two outputs",
    "kernel ridge", "logistic",
)  # fmt: skip


def program_of(name):
    _, X, _ = pipelines.fitted(name)
    if name in ("splines", "logarithm of the target"):
        return with_intervals(name), X
    return pipelines.program(name), X


@cache
def with_intervals(name):
    model, X, y = pipelines.fitted(name)
    return from_sklearn(model, X, calibrate=(X, y))


@pytest.mark.parametrize("name", KINDS)
def test_micropython_gives_the_integers_of_numpy(name):
    program, X = program_of(name)
    x = running.vectors(program, X)
    assert running.micropython(program, x) == running.numpy(program, x)


@pytest.mark.parametrize("name", ["degree 5", "splines"])
def test_and_so_does_its_bytecode(name):
    program, X = program_of(name)
    x = running.vectors(program, X)
    assert running.micropython(program, x, "bytecode") == running.numpy(program, x)


@pytest.mark.parametrize(
    "name", [n for n in pipelines.ALL if n not in ("support vectors", "Gaussian process")]
)
def test_c_gives_the_integers_of_numpy_and_does_nothing_undefined(name, tmp_path):
    program, X = program_of(name)
    x = running.vectors(program, X)
    assert running.c(program, x, tmp_path) == running.numpy(program, x)


def test_the_sources_have_no_floats_and_no_library():
    program, _ = program_of("kernel ridge")
    text = program.c()
    assert [line for line in text.splitlines() if line.startswith("#")] == ["#include <stdint.h>"]
    assert not {"float", "double", "int64_t", "long"} & set(text.replace("(", " ").split())
    assert "import" not in program.python()


@pytest.mark.parametrize("name", KINDS)
def test_a_port_without_floats_can_read_the_module(name):
    """There a decimal number is a syntax error, and a .mpy that holds one is not loaded."""
    program, _ = program_of(name)
    constants = [n.value for n in ast.walk(ast.parse(program.python())) if isinstance(n, ast.Constant)]
    numbers = [v for v in constants if not isinstance(v, str)]
    assert all(type(v) is int and abs(v) < 2**30 for v in numbers)
    assert not any(isinstance(n, ast.Div | ast.Pow) for n in ast.walk(ast.parse(program.python())))


def test_machine_code_for_boards():
    program, _ = program_of("degree 2")
    assert program.mpy("armv6m")[2] >> 2 != 0  # names an architecture
    with pytest.raises(CompileError, match="pdp11"):
        program.mpy("pdp11")


ALONE = """
import sys
import numpy
before = set(sys.modules)
from palpate.fixedpoint import compile
program = compile([(), (0,), (0, 1)], [1.0, 2.0, 0.5], [(0, 10), (-1, 1)])
assert len(program.python()) > 100
import palpate
known = set(sys.stdlib_module_names) | {"numpy", "cython_runtime"}
print(palpate.__file__, sorted({m.split(".")[0] for m in set(sys.modules) - before if m[0] != "_"} - known))
"""


def test_it_works_without_the_rest_of_palpate(tmp_path):
    """In a folder with its own files, numpy and the device's files: it could be published by itself."""
    (tmp_path / "palpate").mkdir()
    (tmp_path / "palpate" / "fixedpoint").symlink_to(Path(palpate.fixedpoint.__file__).parent)
    (tmp_path / "firmware_py").symlink_to(Path(firmware_py.__file__).parent)
    said = subprocess.run(
        [sys.executable, "-c", ALONE], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout
    assert said.split("\n")[0] == "None ['firmware_py', 'palpate']"

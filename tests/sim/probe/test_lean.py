"""What the board is given of the firmware: leaner, and to the same integers."""

import ast
import functools
import subprocess
import sys

import pytest

from palpate.model_export.integers import compiler
from palpate.sim.probe.rp2040 import board_files
from palpate.sim.probe.rp2040.lean import _Facts, lean
from palpate.sim.probe.rp2040.names import borrowed
from tests.model_export import synthetic
from tests.sim.probe.test_three_runtimes import WHOLE, whole_strokes


def firmware():
    return {name: (board_files.FIRMWARE / name).read_text() for name in board_files.modules()}


@functools.cache
def on_the_board():
    return lean(firmware(), MAIN)


def test_the_lean_firmware_under_borrowed_names_gives_the_same_integers_from_frames_to_estimates(tmp_path):
    mine, files = whole_strokes({"field": compiler.compile_model(synthetic.model("field"))}, 12)
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    modules = borrowed({**lean(firmware(), WHOLE), "whole.py": WHOLE})
    whole = modules.pop("whole.py")
    for name, text in modules.items():
        path = tmp_path / "firmware_py" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    begin = "import sys; sys.path.insert(0, '.')\n"
    check = "\nassert not hasattr(pipeline, 'Pipeline'), 'this is the whole firmware'"
    command = [sys.executable, "-c", begin + whole + check]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    assert [[int(x) for x in line.split()] for line in done.stdout.splitlines()] == mine


MAIN = "from firmware_py.boards import rp2_reference\nrp2_reference.main()"


def imported(tree):
    """Where each module lies whose name nothing else in this one has."""
    found = dict(_Facts(tree).modules)
    others = {node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)}
    others |= {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    return {alias: path for alias, path in found.items() if alias not in others}


def bound_at_the_top(tree):
    found = {
        alias.asname or alias.name
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
    return found


MODULES = {
    "numbers.py": "C = 3\nB = C << 2 | 1\nTEXT = {B: 'for people'}\nchanged = 4\n",
    "user.py": "from firmware_py import numbers, idle\n\n\ndef f(A):\n    numbers.changed = A\n"
    "    return numbers.B + numbers.changed\n\n\ndef g():\n    return 5\n",
    "idle.py": "print('imported')\n",
}


def test_whatever_a_module_takes_from_another_is_there():
    found = {path: ast.parse(text) for path, text in on_the_board().items()}
    there = {path: bound_at_the_top(tree) for path, tree in found.items()}
    for path, tree in found.items():
        names = imported(tree)
        taken = [
            (names[node.value.id], node.attr)
            for node in ast.walk(tree)
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in names
        ]
        absent = [(where, name) for where, name in taken if name not in there.get(where, (name,))]
        assert not absent, path


def test_a_table_that_is_worked_out_while_loading_is_worked_out_beforehand():
    found = on_the_board()
    assert set(found) & {"status.py", "outputs.py"} == set()
    assert "FORMATS = {1: ('<I', '')" in found["messages.py"]
    assert "TYPE" not in found["messages.py"] and "identify" not in found["tables.py"]


def test_numbers_stand_in_their_names_place_and_what_nobody_reads_goes():
    found = lean(MODULES, "from firmware_py import user\nuser.f(1)\n")
    assert set(found) == {"user.py", "numbers.py"}
    assert "return 13 + numbers.changed" in found["user.py"]
    assert "def f(A)" in found["user.py"] and "def g" not in found["user.py"]
    assert found["numbers.py"] == "changed = 4"


def test_what_a_docstring_says_goes_too():
    """Its words counted as names in use, and a dozen names took of the board's memory what they need not."""
    text = (
        '"""Words."""\nclass C:\n    """More."""\n    def f(self):\n        """Most."""\n        return 1\n'
    )
    found = lean({"one.py": text}, "from firmware_py import one\none.C().f()\n")
    assert found["one.py"] == "class C:\n\n    def f(self):\n        return 1"


@pytest.mark.parametrize("main", ["user.g()", "getattr(user, 'g')()"])
def test_what_anything_of_that_name_could_mean_stays(main):
    assert "def g" in lean(MODULES, f"from firmware_py import user\n{main}\n")["user.py"]

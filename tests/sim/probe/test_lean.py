"""What the board is given of the firmware: leaner, and to the same integers."""

import subprocess
import sys

import pytest

from palpate.model_export.fixed_point import compiler
from palpate.sim.probe.rp2040 import board_files
from palpate.sim.probe.rp2040.lean import lean
from tests.model_export import synthetic
from tests.sim.probe.test_three_runtimes import WHOLE, whole_strokes


def firmware():
    return {name: (board_files.FIRMWARE / name).read_text() for name in board_files.modules()}


def test_the_lean_firmware_gives_the_same_integers_from_frames_to_estimates(tmp_path):
    mine, files = whole_strokes({"field": compiler.compile_model(synthetic.model("field"))}, 12)
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    for name, text in lean(firmware(), WHOLE).items():
        path = tmp_path / "firmware_py" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    begin = "import sys; sys.path.insert(0, '.')\n"
    check = "\nassert not hasattr(pipeline, 'POINTS'), 'this is the whole firmware'"
    command = [sys.executable, "-c", begin + WHOLE + check]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    assert [[int(x) for x in line.split()] for line in done.stdout.splitlines()] == mine


MODULES = {
    "numbers.py": "C = 3\nB = C << 2 | 1\nTEXT = {B: 'for people'}\nchanged = 4\n",
    "user.py": "from firmware_py import numbers, idle\n\n\ndef f(A):\n    numbers.changed = A\n"
    "    return numbers.B + numbers.changed\n\n\ndef g():\n    return 5\n",
    "idle.py": "print('imported')\n",
}


def test_numbers_stand_in_their_names_place_and_what_nobody_reads_goes():
    found = lean(MODULES, "from firmware_py import user\nuser.f(1)\n")
    assert set(found) == {"user.py", "numbers.py"}
    assert "return 13 + numbers.changed" in found["user.py"]
    assert "def f(A)" in found["user.py"] and "def g" not in found["user.py"]
    assert found["numbers.py"] == "changed = 4"


@pytest.mark.parametrize("main", ["user.g()", "getattr(user, 'g')()"])
def test_what_anything_of_that_name_could_mean_stays(main):
    assert "def g" in lean(MODULES, f"from firmware_py import user\n{main}\n")["user.py"]

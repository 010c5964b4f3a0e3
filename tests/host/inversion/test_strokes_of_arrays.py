"""Strokes of somebody's flat, padded array: imported with its places, and refined with its face in words."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.cli import main
from palpate.sim.probe.noise import level_named
from palpate.sim.probe.sensors import PRESS_FRAMES, SensorModel
from palpate.sim.tissue import Case
from palpate.wire.cells import FULL_SCALE_KPA, PEDESTAL_KPA, SHAPE
from tests.host.inversion.world import ExactField

FACE = "radius=flat&padding=2mm&modulus=80kPa"
DECLARED = """
rows = 16
columns = 26
pitch_mm = 1.5
lift = true
[pressure]
name = "kPa"
[position]
name = "x"
[displacement]
name = "z"
[time]
name = "t"
"""


@pytest.mark.long
def test_a_stroke_of_somebody_s_array_is_refined_from_an_import(tmp_path, capsys):
    case = Case(12.0, 0.5, 10.0, 0.9, fat_stiffening=1.0, gland_stiffening=1.0)
    felt = replace(case, probe_radius_mm=math.inf, padding_mm_per_kPa=2 / 80)
    field = ExactField(felt)
    sensors = SensorModel(field, level_named("typical"), 4)
    field.reach_mm = (-40.0 + sensors.start_mm, 44.0)
    stream = sensors.stroke(press=PRESS_FRAMES)
    counts = np.clip(np.rint(stream.counts), 0, 4095).reshape(-1, *SHAPE)
    np.savez(
        tmp_path / "stroke.npz",
        kPa=counts / 4095 * FULL_SCALE_KPA - PEDESTAL_KPA,
        x=stream.positions_um / 1e3,
        z=stream.displacements_um / 1e3,
        t=stream.times_us / 1e6,
    )
    (tmp_path / "array.toml").write_text(DECLARED)
    words = ["--as", str(tmp_path / "array.toml"), "--out", str(tmp_path)]
    assert main(["import", str(tmp_path / "stroke.npz"), *words]) == 0
    capsys.readouterr()
    assert main(["refine", str(tmp_path / "stroke.mcap"), "--face", FACE, "--json"]) == 0
    one = json.loads(capsys.readouterr().out)["strokes"][0]
    assert one["fits"] and not one["press"], one
    for name, true in (("d_mm", 12.0), ("depth_mm", 6.0), ("t_mm", 12.0), ("E_fat_kPa", 10.0)):
        assert one[name]["low"] < true < one[name]["high"], (name, one[name])

"""The hot loops' viper twins, read as plain Python: they give the plain loops' integers, none over 2^30.

tests/sim/probe/test_machine_code.py runs them as what they are, machine code.
"""

import importlib

import pytest

from firmware_py import status
from palpate.sim.probe.sensors import LEVELS, SensorModel
from tests.firmware_py import checked_int, stages, twins

SOURCES = twins.HOT, twins.STROKE


def in_plain_python(source, watch):
    """The twin's functions with viper's types taken as plain Python, every intermediate watched."""
    return twins.executed(
        source, lambda f: f, lambda tree: checked_int.wrap(tree, source.stem), _watch_=watch
    )


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_each_twin_is_put_in_its_loops_place(source):
    space = in_plain_python(source, lambda value, where: value)
    made = {
        name
        for name, thing in space.items()
        if getattr(thing, "__globals__", None) is space and name[0] != "_"
    }
    assert made - {"install"} == set(twins.places(source))


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_the_same_integers_as_the_plain_loops(source, fields, monkeypatch):
    watch = checked_int.Watch()
    twin = in_plain_python(source, watch)
    model = SensorModel(fields[0], LEVELS["typical"], 1, across_mm=3.9)
    given = model.stroke(80), model.calibration()
    expected = stages.told(*given)
    assert expected[0] == status.OK
    for name, (module, attribute) in twins.places(source).items():
        monkeypatch.setattr(importlib.import_module(f"firmware_py.{module}"), attribute, twin[name])
    assert stages.told(*given) == expected
    assert watch.most > 2**20

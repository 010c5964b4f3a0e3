"""The third runtime: MicroPython 1.9.2 on a Cortex-M0 with 16 KB of RAM gives the host's integers.

A whole stroke is more than its heap, so the small build's stages, and `bins.Places`, each get a micro:bit of
their own (on_microbit). The firmware's pipeline runs on the host and calls them in turn; what one
micro:bit answers is what the next is given, from frames to estimates.
"""

import copy
import importlib
import inspect
import json
from array import array
from collections import Counter
from contextlib import ExitStack

import pytest

from firmware_py import (
    bins,
    evaluator,
    feature_chain,
    features,
    forcemap,
    gauss,
    gaussfit,
    rowpipeline,
    status,
)
from palpate.model_export.fixed_point import compiler
from palpate.sim.probe.flat import Flattener
from palpate.sim.probe.on_microbit import Loaded
from palpate.sim.probe.scripts import ScriptFailed
from tests.firmware_py import vectors
from tests.firmware_py.stages import any_force_map, recorded, strokes
from tests.model_export import synthetic
from tests.model_export.test_micropython import rows

VECTORS = 100
FRAMES = 24
BINS, WIDTH_UM = 32, 3000
STAGES = (
    ("rowpipeline.add_rows", "rowpipeline.mean_rows"),
    ("feature_chain.move_all",),
    ("traces.map_rows", "feature_chain.widest_gap"),
    ("search.search",),
    ("gaussfit.fit_from",),
    ("gaussfit.flat", "profile.measure"),
    ("features.from_fit", "features.from_profile", "features.finish"),
)
MODULES = (
    *("bins", "calib", "columns", "feature_chain", "features", "fixed", "forcemap", "gauss", "gaussfit"),
    *("pipeline", "profile", "rowpipeline", "search", "stuck", "traces"),
)
EVALUATOR = ("evaluator.compute", "evaluator.verdict")
CALIBRATION = frozenset(("offset", "gain", "f"))  # never change in a stroke: in flash
MODEL = frozenset(inspect.signature(evaluator.Tables).parameters)


def answers(streams, force_map, model):
    """Everything that comes out of each stroke, as integers."""
    out = array("i", bytes(4 * evaluator.OUT_SIZE))
    for k, (stream, calibration) in enumerate(streams):
        p = rowpipeline.RowPipeline(calibration, 6, 20, BINS, WIDTH_UM)
        codes = [
            p.add_frame(packed, int(x), int(d))
            for packed, x, d in zip(stream.packed, stream.positions_um, stream.displacements_um)
        ]
        code = p.finish(force_map if k % 4 else None)
        estimate = [model.evaluate(p.features, out), *out]
        flat = array("i", bytes(4 * gauss.PARAMS))
        gaussfit.flat(p.map, feature_chain.POINTS, flat)
        yield [*codes, code, p.place_um, p.n, *p.map, *p.fit, *p.profile, *p.features, *flat, *estimate]


def largest(calls):
    """For each argument the longest that it ever is."""
    return [max(these, key=len) if hasattr(these[0], "__len__") else these[0] for these in zip(*calls)]


class Rack:
    """Micro:bits with functions on them, put in the place of the host's own."""

    def __init__(self, stack, monkeypatch):
        self._stack, self._monkeypatch = stack, monkeypatch
        self.calls = Counter()

    def add(self, examples, in_flash, replace=True):
        """A micro:bit with these functions."""
        loaded = self._stack.enter_context(Loaded(examples, in_flash))
        print(json.dumps({"functions": list(examples), "free bytes": loaded.bit.free_bytes()}))
        for name in examples if replace else ():
            module, _, function = name.rpartition(".")
            self._monkeypatch.setattr(f"firmware_py.{module}.{function}", self._caller(loaded, name))
        return loaded

    def _caller(self, loaded, name):
        def call(*arguments):
            self.calls[name] += 1
            return loaded.call(name, *arguments)

        return call

    def add_places(self):
        """A micro:bit that keeps the stroke's places."""
        numbers = array("i", bytes(4 * BINS))
        loaded = self.add(
            {
                "bins.Places": (BINS, WIDTH_UM),
                "bins.Places.reset": (),
                "bins.Places.enter": (0, 0),
                "bins.Places.order": (numbers, numbers, bytearray(BINS)),
            },
            frozenset(),
            replace=False,
        )
        rack = self

        class Places:
            def __init__(self, n_bins, width_um):
                loaded.call("bins.Places", n_bins, width_um)

            def __getattr__(self, name):
                if name == "count":
                    return loaded.kept("count", BINS)
                return loaded.attribute(name)

            def reset(self):
                loaded.call("bins.Places.reset")

            def enter(self, x_um, d_um):
                rack.calls["bins.Places.enter"] += 1
                return loaded.call("bins.Places.enter", x_um, d_um)

            def order(self, *arrays):
                rack.calls["bins.Places.order"] += 1
                return loaded.call("bins.Places.order", *arrays)

        self._monkeypatch.setattr(bins, "Places", Places)


@pytest.fixture
def rack(monkeypatch):
    with ExitStack() as stack:
        yield Rack(stack, monkeypatch)


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("number", [25, pytest.param(100, marks=pytest.mark.long)])
def test_whole_strokes_from_frames_to_estimates(rack, number):
    force_map = forcemap.load(any_force_map())
    model = compiler.compile_model(synthetic.model("field"))
    streams = list(strokes(number, FRAMES))
    names = [name for stage in (*STAGES, EVALUATOR) for name in stage]
    with recorded(*names, most=200) as calls:
        mine = list(answers(streams, force_map, model))
    examples = {name: largest([call.before for call in calls[name]]) for name in names}
    for stage in STAGES:
        rack.add({name: examples[name] for name in stage}, CALIBRATION)
    rack.add({name: examples[name] for name in EVALUATOR}, MODEL)
    rack.add_places()
    for k, theirs in enumerate(answers(streams, force_map, model)):
        assert theirs == mine[k], f"stroke {k}"
    print(json.dumps({"strokes": len(mine), "numbers": sum(map(len, mine)), "calls": rack.calls}))
    assert set(rack.calls) == {*names, "bins.Places.enter", "bins.Places.order"}
    assert rack.calls["rowpipeline.add_rows"] == rack.calls["bins.Places.enter"] == number * FRAMES
    for name in ("feature_chain.move_all", "traces.map_rows", "gaussfit.fit_from", "evaluator.compute"):
        assert rack.calls[name] >= 0.6 * number
    codes = Counter(answer[FRAMES] for answer in mine)
    assert codes[status.OK] >= 0.6 * number


@pytest.mark.parametrize(("kind", "degree"), [("thesis", 2), ("field", 2), ("field", 3)])
def test_a_hundred_estimates_of_a_whole_model(rack, kind, degree):
    """Features in, the five outputs with their intervals out."""
    spec = synthetic.model(kind, degree)
    model = compiler.compile_model(spec)
    out = array("i", bytes(4 * evaluator.OUT_SIZE))
    given = [array("i", row) for row in rows(spec, VECTORS)]
    assert len(given[0]) == features.COUNT
    with recorded(*EVALUATOR, most=1) as calls:
        mine = [[model.evaluate(x, out), *out] for x in given]
    rack.add({name: calls[name][0].before for name in EVALUATOR}, MODEL)
    assert [[model.evaluate(x, out), *out] for x in given] == mine
    assert rack.calls["evaluator.compute"] == VECTORS


def test_no_function_of_the_pipeline_stays_behind():
    """Each goes to a micro:bit in one of these tests, but for what reads a stored force map."""
    flat = Flattener()
    for name in (*(name for stage in STAGES for name in stage), *vectors.NAMES):
        flat.add(name)
    have = set()
    for module in MODULES:
        for name, thing in vars(importlib.import_module(f"firmware_py.{module}")).items():
            if inspect.isfunction(thing) and thing.__module__ == f"firmware_py.{module}":
                have.add(f"{module}.{name}")
    assert have - set(flat.names) == {"forcemap.load"}
    assert len(have) > 50


@pytest.mark.parametrize("name", vectors.NAMES)
def test_a_hundred_calls_of_what_the_whole_build_does_to_cells(rack, name):
    """On a few bins each, for a stroke's cells are 53 KB."""
    calls = list(vectors.of(name, VECTORS))
    loaded = rack.add({name: largest(calls)}, CALIBRATION, replace=False)
    plain = vectors.plain(name)
    for mine in calls:
        theirs = copy.deepcopy(mine)
        assert loaded.call(name, *theirs) == plain(*mine)
        assert theirs == mine
    assert len(calls) == VECTORS


def test_what_goes_wrong_there_is_told(rack):
    """The proof could not fail otherwise."""
    y = array("i", range(57))
    loaded = rack.add({"gaussfit.flat": (y, 57, array("i", bytes(20)))}, frozenset(), replace=False)
    with pytest.raises(ScriptFailed, match="IndexError"):
        loaded.call("gaussfit.flat", y, 58, array("i", bytes(20)))
    with pytest.raises(ScriptFailed, match="MemoryError"):
        Loaded({"gaussfit.flat": (array("i", range(3000)), 57, array("i", bytes(20)))})

"""Emulated probes, a model for them, and the command line, for all tests of the host."""

from __future__ import annotations

import itertools
import os
from dataclasses import replace

import numpy as np
import pytest

from palpate import array
from palpate.cli import main
from palpate.model_export.exporter import export
from palpate.sim.probe.emulated import EmulatedProbe
from palpate.sim.probe.over_lump import strokes_over
from tests.host.probes import FRAMES, LUMP
from tests.model_export import synthetic

SERIALS = itertools.count(1000 * os.getpid() % 100_000_000)


@pytest.fixture(autouse=True)
def own_directories(tmp_path_factory, monkeypatch):
    """Emulated probes of other tests, and the user's own, stay out of sight."""
    base = tmp_path_factory.mktemp("run")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(base))
    # an array that somebody opens is that of children, too, but not longer than the test
    monkeypatch.setenv(array.VARIABLE, os.environ.get(array.VARIABLE, ""))


@pytest.fixture(scope="session")
def bench():
    """Two strokes over one lump through typical sensors, and the calibration that knows their dead cells."""
    return strokes_over(LUMP, "typical", 1, FRAMES, 2, press=False)


@pytest.fixture(scope="session")
def strokes(bench):
    return bench[0]


@pytest.fixture(scope="session")
def key_dir(real_key_dir):
    return real_key_dir


@pytest.fixture(scope="session")
def specs(bench):
    """Two made-up models whose domain lies around the stroke's own features."""
    from palpate.firmware_twin.replay_core import Replay

    pipeline = Replay(plain=True)
    pipeline.stream(bench[0][0], bench[1])
    felt = pipeline.features()
    return [around(synthetic.model("thesis", seed=seed), felt) for seed in (1, 2)]


def around(spec, felt):
    from firmware_py import feature_names

    here = np.array([felt[feature_names.NAMES.index(name)] for name in spec.features])
    moved = here - np.array(spec.centre)

    def shift(values):
        return tuple((np.array(values) + moved).tolist())

    domain = replace(spec.domain, lo=shift(spec.domain.lo), hi=shift(spec.domain.hi))
    return replace(
        spec, centre=shift(spec.centre), clip_lo=shift(spec.clip_lo), clip_hi=shift(spec.clip_hi),
        domain=domain, lump=(),
    ).validate()  # fmt: skip


@pytest.fixture(scope="session")
def images(specs, key_dir):
    """The two models, signed, the second newer."""
    return [export(spec, key_dir)[0] for spec in specs]


@pytest.fixture
def emulated(bench, public_key):
    """Makes emulated probes, and ends them."""
    running = []

    def make(runtime="cpython", **options):
        strokes, calibration = bench
        serial = b"%08d" % next(SERIALS)  # two workers' pseudo-terminals may get one another's names
        given = {"strokes": strokes, "calibration": calibration, "public_key": public_key, "serial": serial}
        # a busy machine must not lose frames where the test does not ask for it
        given["roomy"] = not options.keys() & {"to_host", "to_device", "baud"}
        probe = EmulatedProbe(runtime, **{**given, **options})
        running.append(probe)
        return probe.start()

    yield make
    for probe in running:
        probe.stop()


@pytest.fixture
def rotten_store(tmp_path):
    """A probe's store in which both copies of the settings are damaged."""
    store = tmp_path / "store"
    store.mkdir()
    for name in ("set0", "set1"):
        (store / name).write_bytes(bytes(range(40)))
    return store


@pytest.fixture
def palpate(capsys):
    """Runs the command line in this process: (exit status, standard output, standard error)."""

    def run(*args):
        capsys.readouterr()
        status = main([str(arg) for arg in args])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run

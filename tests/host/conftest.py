"""Emulated probes, a model for them, and the command line, for all tests of the host."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from host.cli import main
from host.cli.emulate import strokes_over
from host.link.probe import Probe
from host.link.transport import open_transport
from model_export import keys
from model_export.exporter import export
from sim.probe.emulated import EmulatedProbe
from tests.image import synthetic
from tests.waiting import wait_until

LUMP = "d12h07e20f09"
FRAMES = 40
SERIALS = itertools.count(1000 * os.getpid() % 100_000_000)


@pytest.fixture(autouse=True)
def own_directories(tmp_path_factory, monkeypatch):
    """Emulated probes of other tests, and the user's own, stay out of sight; so do keys' witnesses."""
    base = tmp_path_factory.mktemp("run")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(base))
    monkeypatch.setenv("PALPATE_STATE", str(tmp_path_factory.getbasetemp() / "state"))


@pytest.fixture(scope="session")
def bench():
    """Two strokes over one lump through typical sensors, and the calibration that knows their dead cells."""
    return strokes_over(LUMP, "typical", 1, FRAMES, 2)


@pytest.fixture(scope="session")
def strokes(bench):
    return bench[0]


@pytest.fixture(scope="session")
def key_dir(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PALPATE_STATE", str(tmp_path_factory.getbasetemp() / "state"))
        directory = tmp_path_factory.mktemp("key") / "key"
        keys.generate(directory, height=5, width=8)
    return directory


@pytest.fixture(scope="session")
def public_key(key_dir):
    return (key_dir / "public.key").read_bytes()


@pytest.fixture(scope="session")
def specs(bench):
    """Two made-up models whose domain lies around the stroke's own features."""
    from host.replay_core import Replay

    pipeline = Replay(plain=True)
    pipeline.stream(bench[0][0], bench[1])
    felt = pipeline.features()
    return [around(synthetic.model("thesis", seed=seed), felt) for seed in (1, 2)]


def around(spec, felt):
    from firmware_py import features

    here = np.array([felt[features.NAMES.index(name)] for name in spec.features])
    moved = here - np.array(spec.centre)

    def shift(values):
        return tuple((np.array(values) + moved).tolist())

    domain = replace(spec.domain, lo=shift(spec.domain.lo), hi=shift(spec.domain.hi))
    return replace(
        spec, centre=shift(spec.centre), clip_lo=shift(spec.clip_lo), clip_hi=shift(spec.clip_hi),
        domain=domain, lump=(),
    ).validate()  # fmt: skip


@pytest.fixture(scope="session")
def images(specs, key_dir, tmp_path_factory):
    """The two models, signed, the second newer."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PALPATE_STATE", str(tmp_path_factory.getbasetemp() / "state"))
        return [export(spec, key_dir)[0] for spec in specs]


@pytest.fixture
def emulated(bench, public_key):
    """Makes emulated probes, and ends them."""
    running = []

    def make(runtime="cpython", **words):
        strokes, calibration = bench
        serial = b"%08d" % next(SERIALS)  # two workers' pseudo-terminals may get one another's names
        given = {"strokes": strokes, "calibration": calibration, "public_key": public_key, "serial": serial}
        # a busy machine must not lose frames where the test does not ask for it
        given["roomy"] = not words.keys() & {"to_host", "to_device", "baud"}
        probe = EmulatedProbe(runtime, **{**given, **words})
        running.append(probe)
        return probe.start()

    yield make
    for probe in running:
        probe.stop()


def connect(probe: EmulatedProbe, recorder=None) -> Probe:
    """A client that finds the probe again under whatever name its port has."""
    return Probe(open_transport(probe.port), recorder, lambda: open_transport(probe.port))


def settled(probe: Probe) -> dict[str, int]:
    """The probe's counts after the stream's end, once every frame it acquired has come or is counted lost.

    What the stream's end had promised and has not come is counted once the line is quiet.
    """
    told = probe.statistics()

    def all_are_counted():
        return probe.frame_counts.received + probe.frame_counts.lost >= told["frames_acquired"]

    wait_until(all_are_counted, "the last frames, or the count of what is missing")
    assert probe.frame_counts.received + probe.frame_counts.lost == told["frames_acquired"]
    return told


@pytest.fixture
def palpate(capsys):
    """Runs the command line in this process: (exit status, standard output, standard error)."""

    def run(*args):
        capsys.readouterr()
        status = main([str(arg) for arg in args])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


class Started(subprocess.Popen):
    """A program that a test which fails does not wait for."""

    def __exit__(self, *error):
        if error[0] is not None:
            self.kill()
        super().__exit__(*error)


def start_palpate(*args, prepare=lambda: None, **words):
    """The command line as a process of its own; `prepare` is called in it before it begins."""

    def begin():
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # the tests themselves may run where Ctrl-C is ignored
        prepare()

    command = [sys.executable, "-m", "host.cli", *(str(arg) for arg in args)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", **words.pop("env", {})}
    return Started(command, env=environment, preexec_fn=begin, **{**pipes, **words})

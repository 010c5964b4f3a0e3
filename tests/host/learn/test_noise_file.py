"""Whatever takes a noise level takes a characterised sensor's file as well, and does the same with it."""

from dataclasses import asdict, replace
from pathlib import Path

import pytest

from palpate.learn.cylinders import fit_to_cylinders
from palpate.learn.observed import noise_named
from palpate.learn.thesis.polynomial import fit_thesis_model
from palpate.sim.probe.noise import LEVELS
from palpate.sim.probe.over_lump import strokes_over
from tests.host.learn.conftest import SMALL
from tests.host.probes import LUMP
from tests.studies.retrained import Bench
from tests.studies.settings import STUDIES


@pytest.fixture(scope="module")
def sensor(tmp_path_factory):
    """A file of the very numbers of a good sensor."""
    path = tmp_path_factory.mktemp("sensor") / "sensor.toml"
    numbers = {name: value for name, value in asdict(LEVELS["good"]).items() if name != "quantise"}
    path.write_text("[noise]\n" + "".join(f"{name} = {value}\n" for name, value in numbers.items()))
    return str(path)


@pytest.fixture(scope="module")
def lumps(strokes):
    """Some of them: the others take their noise from the same place."""
    return replace(
        strokes,
        lumps=strokes.lumps[:16],
        rim=strokes.rim[:4],
        plain=strokes.plain[:2],
        others=strokes.others[:6],
    )


def the_same_as_good_and_not_as_typical(sensor, made):
    assert made(sensor) == made("good") != made("typical")


def test_the_emulated_probe(sensor):
    def felt(noise):
        streams, calibration = strokes_over(LUMP, noise, 1, 12, press=False)
        return streams[0].packed, calibration.to_bytes()

    the_same_as_good_and_not_as_typical(sensor, felt)


def test_a_field_model_is_trained_for_it(sensor, lumps):
    def fitted(noise):
        training = fit_to_cylinders(lumps, noise, others=(), scope=SMALL).spec.training
        assert training["noise"] == Path(noise).name
        return training["hash"]

    the_same_as_good_and_not_as_typical(sensor, fitted)


def test_a_thesis_model_is_trained_for_it(sensor, strokes):
    runs = [lump.low for lump in strokes.lumps[:32]]

    def fitted(noise):
        training = fit_thesis_model(runs, noise=noise, draws=1).training
        assert training["noise"] == Path(noise).name
        return training["hash"]

    the_same_as_good_and_not_as_typical(sensor, fitted)


def test_a_study_starts_from_it(sensor, lumps):
    """The first setting of the pitch study is the array as it is: the bench's own sensors."""

    def first(noise):
        return next(STUDIES["pitch"].run(Bench(lumps, noise=noise_named(noise))))

    the_same_as_good_and_not_as_typical(sensor, first)

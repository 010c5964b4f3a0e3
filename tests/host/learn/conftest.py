"""A small set of committed strokes, and a small model fitted to them."""

from pathlib import Path

import pytest

from palpate.learn import data, model, scopes
from palpate.sim.probe.sensors import LEVELS
from tests.studies.retrained import Bench

STROKES = Path(__file__).parent / "data"
SMALL = scopes.TOLD.of(scopes.Recipe("field", scopes.PILOT_FEATURES, 1))


@pytest.fixture(scope="session")
def strokes():
    """96 lumps, 29 outside the ranges, 10 plain tissues, 24 others, with their presses (`make_data.py`)."""
    return data.read_strokes(STROKES)


@pytest.fixture(scope="session")
def bench(strokes):
    return Bench(strokes)


@pytest.fixture(scope="session")
def parts(bench):
    """Strokes to train on, over the rim, and over lumps to test on."""
    return bench.parts(LEVELS["typical"])


@pytest.fixture(scope="session")
def fitted(parts):
    return model.fit_model(SMALL, parts[0])

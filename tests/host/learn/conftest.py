"""A small set of committed strokes, and a small model fitted to them."""

from pathlib import Path

import pytest

from palpate.learn import data, model, scopes
from palpate.learn.bench import Bench

STROKES = Path(__file__).parent / "data"
SMALL = scopes.TOLD.of(scopes.Recipe("field", scopes.PILOT_FEATURES, 1))


@pytest.fixture(scope="session")
def strokes():
    """96 lumps, 24 plain tissues, twice 16 lumps outside the ranges, at two forces each (`make_data.py`)."""
    return data.read(STROKES)


@pytest.fixture(scope="session")
def bench(strokes):
    return Bench(strokes)


@pytest.fixture(scope="session")
def parts(bench):
    return bench.parts("typical", draws=(2, 2, 2))


@pytest.fixture(scope="session")
def fitted(parts):
    return model.fit_model(SMALL, parts[0], parts[1])

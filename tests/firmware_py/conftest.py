"""Finite-element strokes (made by make_strokes.py), and a force map learned from them, for these tests."""

import numpy as np
import pytest

from palpate.firmware_twin.replay_core import Replay
from palpate.model_export.integers import force_map
from palpate.sim.probe.sensors import StrokeField
from tests.firmware_py.strokes import read_strokes


@pytest.fixture(scope="session")
def all_strokes():
    return read_strokes()


@pytest.fixture(scope="session")
def fields(all_strokes):
    """The strokes with a lump, as fields to read sensors from."""
    return [StrokeField(low, high) for low, high in all_strokes[:-1]]


@pytest.fixture(scope="session")
def flat_field(all_strokes):
    """Tissue without a lump."""
    return StrokeField(*all_strokes[-1])


@pytest.fixture(scope="session")
def fitted_map(all_strokes):
    """A force map learned from these strokes."""
    low, high = ([pair[i] for pair in all_strokes] for i in (0, 1))
    return force_map.fit(
        np.concatenate([s.images_kPa for s in low]),
        np.concatenate([s.displacement_mm for s in low]),
        np.concatenate([s.images_kPa for s in high]),
        np.concatenate([s.displacement_mm for s in high]),
    )


@pytest.fixture(scope="session")
def map_blob(fitted_map):
    return force_map.blob(fitted_map)


@pytest.fixture
def replay(map_blob):
    """The compiled pipeline with the force map; bins for strokes longer than a board has room for."""
    return Replay(map_blob, n_bins=64)

"""Finite-element strokes (made by make_strokes.py), and a force map learned from them, for these tests."""

import dataclasses

import numpy as np
import pytest

from host.replay_core import Replay
from model_export import force_map
from sim.probe.sensors import StrokeField
from sim.tissue import Case, Stroke
from tests.pipeline.make_strokes import FILE


def _stroke(code, positions, images, depths):
    """A stroke of which only what the sensors need is known."""
    values = dict.fromkeys((f.name for f in dataclasses.fields(Stroke)), 0)
    values |= {
        "case": Case.from_code(code),
        "positions_mm": positions,
        "images_kPa": np.float64(images),
        "displacement_mm": np.float64(depths),
    }
    return Stroke(**values)


def read_strokes():
    """Pairs (low, high) of strokes at two forces; the last pair has no lump."""
    table = np.load(FILE)
    rows = zip(table["codes"], table["images_kPa"], table["depths_mm"], strict=True)
    strokes = [_stroke(str(code), table["positions_mm"], images, depths) for code, images, depths in rows]
    return list(zip(strokes[::2], strokes[1::2], strict=True))


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
    """The compiled pipeline with the force map."""
    return Replay(map_blob)

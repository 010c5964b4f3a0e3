"""A model of the pressure alone: recordings without displacement have a model to go with them."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.dataset import table
from palpate.dataset.strokes import observe_data_set
from palpate.firmware_twin.replay_core import Replay
from palpate.importing import importer
from palpate.learn.cylinders import fit_to_cylinders
from palpate.learn.observed import NAMES, OF_THE_DISPLACEMENT
from palpate.learn.scopes import PRESSURE_ONLY, TOLD, Recipe
from palpate.model_export.exporter import export
from palpate.model_export.image_builder import inspect
from palpate.model_export.integers import force_map
from palpate.model_export.integers.reference import evaluate
from palpate.model_export.schema import ModelSpec
from palpate.sim.probe.sensors import LEVELS, SensorModel
from palpate.stroke.replay import replay
from tests.host.probes import DECLARED, arrays_of

SMALL = Recipe("small", PRESSURE_ONLY.features, 1)
WITHOUT_DISPLACEMENT = replace(DECLARED, displacement="")


@pytest.fixture(scope="module")
def spec(strokes):
    return fit_to_cylinders(strokes, others=(), scope=TOLD.of(SMALL)).spec


@pytest.fixture(scope="module")
def lump(bench):
    """Two strokes over a lump, as the sensors read them."""
    field = bench.test[0].field
    models = [SensorModel(field, LEVELS["typical"], seed) for seed in (1, 2)]
    return models[0].calibration(), [model.stroke(50) for model in models]


def features(spec, strokes, calibration, alter=lambda depth: depth):
    pipeline = Replay(force_map.blob(spec.force_map))
    out = []
    for s in strokes:
        pipeline.stroke(s.packed, s.positions_um, alter(s.displacements_um), calibration)
        out.append(pipeline.features()[[NAMES.index(name) for name in spec.features]])
    return np.array(out)


def test_neither_features_nor_force_map_know_the_displacement(spec, lump):
    """Once the force map took ln D all the same, and evened out nothing where there was none."""
    assert not set(spec.features) & set(OF_THE_DISPLACEMENT)
    calibration, strokes = lump
    there = features(spec, strokes, calibration)
    for alter in (np.zeros_like, lambda depth: 3 * depth, lambda depth: -depth):
        assert np.array_equal(there, features(spec, strokes, calibration, alter))
    bare = Replay(None)
    bare.stroke(strokes[0].packed, strokes[0].positions_um, strokes[0].displacements_um, calibration)
    assert not np.array_equal(there[0], bare.features()[[NAMES.index(name) for name in spec.features]])


def test_it_goes_from_the_fit_to_a_recording_without_displacement(spec, lump, tmp_path, real_key_dir):
    """Written, signed, in the image an import's estimates are made by; replayed bit for bit; judged."""
    spec.save(tmp_path / "pressure.json")
    image, _ = export(ModelSpec.load(tmp_path / "pressure.json"), real_key_dir)
    assert not set(inspect(image).features) & set(OF_THE_DISPLACEMENT)
    strokes = lump[1]
    np.savez(tmp_path / "a.npz", **arrays_of(strokes))
    done = importer.import_file(tmp_path / "a.npz", tmp_path / "a.mcap", WITHOUT_DISPLACEMENT, image)
    assert done.missing == ("displacement",)
    found = list(replay(tmp_path / "a.mcap"))
    assert [stroke.identical for stroke in found] == [True, True]
    truth = strokes[0].truth.outputs()
    (tmp_path / "set.csv").write_text(
        "recording,stroke,lump,d_mm,h\n"
        + "".join(f"a.mcap,{n},A,{truth['d_mm']},{truth['h']}\n" for n in (1, 2))
    )
    seen = observe_data_set(table.read(tmp_path / "set.csv"), spec)
    for stroke, said in zip(found, seen.X):
        columns = [NAMES.index(name) for name in spec.features]
        value = evaluate(spec, said[columns])["value"][0]
        assert stroke.probe.outputs["d_mm"]["value"] == pytest.approx(value[2], rel=2e-3)
        assert value[2] == pytest.approx(truth["d_mm"], rel=0.25)


def test_a_map_of_the_displacement_is_not_passed_off_as_one_of_the_pressure(spec):
    said = dict(spec.force_map)
    assert said["ln_D"] is None
    even = np.array(said["even"])
    even[2, 0] = 0.1
    with pytest.raises(ValueError, match="of the pressure alone has coefficients of the displacement"):
        force_map.ForceMap.from_dict(said | {"even": even.tolist()})

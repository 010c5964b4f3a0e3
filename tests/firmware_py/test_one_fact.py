"""What stands twice, for speed or for another language, says the same as its one home."""

from array import array

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from firmware_py import (
    bins,
    calibrate,
    evaluator,
    feature_names,
    features,
    fixed,
    gauss,
    gaussfit,
    geometry,
    outputs,
    polynomial,
    sensor_array,
    settings,
    stroke_state,
    verdict,
)
from firmware_py.boards import scan_order
from palpate.sim.tissue import face_sensors
from palpate.view.app import array_module
from palpate.wire import cells, packing
from tests.firmware_py import output_numbers


def test_the_outputs_table_and_the_numbers_taken_from_it():
    for path, text in output_numbers.written().items():
        assert path.read_text(encoding="utf-8") == text, f"run python -m {output_numbers.__name__}"
    assert evaluator.ALL_DOWNS == (1 << evaluator.SIGMA_DOWN) - 1 == (1 << 4 * outputs.COUNT) - 1
    assert sum(16**j for j in range(outputs.COUNT)) == evaluator.ALIKE
    assert outputs.PARTS == ("value", "low", "high") and verdict.E_HIGH == verdict.E_LOW + 1


def test_a_place_in_the_models_arrays_has_one_number():
    shared = (vars(module) for module in (verdict, polynomial))
    for names in shared:
        for name, number in names.items():
            if name.isupper() and not name.startswith("_") and hasattr(evaluator, name):
                assert getattr(evaluator, name) == number, name


def test_a_feature_and_a_parameter_of_the_gaussian_stand_where_their_names_say():
    assert len(feature_names.NAMES) == features.COUNT
    of_the_press = [name for name in feature_names.NAMES if name.startswith("press_")]
    bump = feature_names.NAMES[features.BUMP :]
    assert bump[0] == "ln_bump" and bump[features._PULL - features.BUMP] == "pull_3_5"
    assert bump[features._LIFT - features.BUMP] == "lift_0_2"
    others = [name for name in feature_names.NAMES if name not in (*of_the_press, *bump)]
    places = {name: vars(features)["_" + name.upper()] for name in others}
    first = features.PRESS, features.PRESS_OUTER
    later = [name for name in of_the_press if "_outer_" in name]
    for at, names in zip(first, ([n for n in of_the_press if n not in later], later)):
        places |= {name: at + k for k, name in enumerate(names)}
    places |= {name: features.BUMP + k for k, name in enumerate(bump)}
    assert [places[name] for name in feature_names.NAMES] == list(range(features.COUNT))
    assert features._LN2 == gauss._LN2 == gaussfit._LN2 == fixed.LN2
    for module in (features, gaussfit):
        for name in ("BASE", "AMP", "CENTRE", "STDEV", "COST", "PARAMS"):
            assert getattr(module, "_" + name, getattr(gauss, name)) == getattr(gauss, name), (module, name)
    for name in ("_BE", "_CE", "_SCALE", "_MEAN", "_SHIFT"):
        assert getattr(gaussfit, name) == getattr(gauss, name), name


def test_the_tissues_sensors_are_the_reference_arrays():
    """Another array feels strokes through these places; for the reference's own nothing is resampled."""
    assert (face_sensors.ALONG, face_sensors.ACROSS) == (sensor_array.ROWS, sensor_array.COLUMNS)
    assert face_sensors.PITCH_MM == sensor_array.PITCH_UM / 1000
    assert np.array_equal(face_sensors.SENSORS_MM, cells.ROW_MM)
    assert np.array_equal(face_sensors.places_mm(face_sensors.ACROSS), cells.COLUMN_MM)


def test_the_page_is_handed_the_probes_array():
    said = dict(line[len("export const ") : -1].split(" = ") for line in array_module().decode().splitlines())
    assert {name: float(number) for name, number in said.items()} == {
        "ROWS": geometry.ROWS,
        "COLUMNS": geometry.COLUMNS,
        "CELLS": geometry.CELLS,
        "PITCH_MM": geometry.PITCH_UM / 1000,
    }


@given(st.integers(0, 2**32 - 1))
def test_everybody_packs_and_unpacks_a_frame_alike(seed):
    """Five loops of the firmware unpack in place; `bins.put_cells` is what they must agree with."""
    counts = np.random.default_rng(seed).integers(0, geometry.FULL_COUNT + 1, geometry.CELLS)
    expected = counts.tolist()
    packed = packing.pack(counts)
    assert len(packed) == geometry.FRAME_BYTES
    on_the_board = bytearray(geometry.FRAME_BYTES)
    scan_order.pack(expected, range(geometry.CELLS), on_the_board)
    assert bytes(on_the_board) == packed

    assert packing.unpack(packed).tolist() == expected
    cells = [0] * geometry.CELLS
    bins.put_cells(packed, 0, cells, 0)
    assert cells == expected
    bins.add_cells(packed, 0, cells, 0)
    assert cells == [2 * count for count in expected]
    total, before = array("i", bytes(4 * geometry.CELLS)), array("H", bytes(2 * geometry.CELLS))
    calibrate.add_frame(packed, total, before, True)
    assert total.tolist() == before.tolist() == expected
    assert least_sum_in_contact(packed) == int(counts.sum())


def least_sum_in_contact(packed):
    """The sum of all counts, from where the frame ceases to be a contact as the zero rises."""
    values = list(settings.Settings().values)
    pressure = values[settings.CONTACT_THRESHOLD]
    excess = -(-pressure * geometry.COUNTS_A_100_PA // 100)  # counts that are this pressure
    low, high = -excess - 1, geometry.CELLS * geometry.FULL_COUNT
    while high - low > 1:
        zero = (low + high) // 2
        touches = stroke_state.StrokeState(values, zero).in_contact(packed)
        low, high = (zero, high) if touches else (low, zero)
    return low + excess

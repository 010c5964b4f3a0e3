"""What stands twice, for speed or for another language, says the same as its one home."""

from firmware_py import evaluator, geometry, outputs, polynomial, verdict
from palpate.view.app import array_module


def test_the_outputs_table_and_the_numbers_taken_from_it():
    assert outputs.COUNT == len(outputs.TABLE) == len(outputs.NAMES)
    assert outputs.NAMES[outputs.E_INV23] == "E_inv23"
    assert len(outputs.PARTS) * outputs.COUNT == outputs.VALUES
    assert evaluator.OUTPUTS == polynomial.OUTPUTS == verdict.OUTPUTS == outputs.COUNT
    assert evaluator.E_OUTPUT == outputs.E_INV23
    assert evaluator.PREDICTED == 3 * outputs.COUNT and evaluator.WORK == 4 * outputs.COUNT
    assert tuple(range(outputs.VALUES, outputs.VALUES + 4)) == (
        verdict.FLAGS,
        verdict.DISTANCE,
        verdict.LEVEL,
        verdict.OUT_SIZE,
    )
    value, low, high = (3 * outputs.E_INV23 + k for k in range(3))
    assert outputs.PARTS == ("value", "low", "high") and (low, high) == (verdict.E_LOW, verdict.E_HIGH)
    assert 3 * outputs.NAMES.index("F_N_per_m") == verdict.FORCE and value == low - 1


def test_a_place_in_the_models_arrays_has_one_number():
    shared = (vars(module) for module in (verdict, polynomial))
    for names in shared:
        for name, number in names.items():
            if name.isupper() and not name.startswith("_") and hasattr(evaluator, name):
                assert getattr(evaluator, name) == number, name


def test_the_page_is_handed_the_probes_array():
    said = dict(line[len("export const ") : -1].split(" = ") for line in array_module().decode().splitlines())
    assert {name: float(number) for name, number in said.items()} == {
        "ROWS": geometry.ROWS,
        "COLUMNS": geometry.COLUMNS,
        "CELLS": geometry.CELLS,
        "PITCH_MM": geometry.PITCH_UM / 1000,
        "FULL_SCALE_KPA": geometry.FULL_SCALE_PA / 1000,
    }

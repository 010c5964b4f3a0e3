"""What the analogue circuit makes of the matrix, held to cases that can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sim.probe.readout import FLOATING, REFERENCE, Readout, errors

FILM_OHM = 10e3


@given(st.lists(st.floats(0, 25), min_size=12, max_size=12))
def test_an_ideal_circuit_reads_every_cell_as_it_is(cells):
    pressure_kPa = np.reshape(cells, (3, 4))
    ideal = Readout(reference_V=0.5, row_switch_ohm=1e-6, hold_ohm=1000.0, offset_V=0.0)
    assert errors(ideal, pressure_kPa, FILM_OHM, 5.0) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("column_switch_ohm", [None, 100.0])
def test_one_cell_is_an_inverting_amplifier(column_switch_ohm):
    """Reference over the resistances in the way, times the feedback; the hold resistor hardly conducts."""
    one = Readout(0.5, row_switch_ohm=200.0, hold_ohm=1e12, column_switch_ohm=column_switch_ohm, offset_V=0.0)
    way_ohm = FILM_OHM + 200.0 + (column_switch_ohm or 0.0)
    expected_V = 0.5 / way_ohm * one.feedback_ohm(FILM_OHM)
    assert one.read(np.array([[25.0]]), FILM_OHM)[0, 0] == pytest.approx(expected_V, rel=1e-4)


def test_full_scale_reaches_the_supply():
    ideal = Readout(reference_V=0.5, row_switch_ohm=1e-6, hold_ohm=1e9, offset_V=0.0)
    assert ideal.read(np.array([[25.0]]), FILM_OHM)[0, 0] == pytest.approx(3.3 - 0.5, rel=1e-4)


def test_a_cell_alone_shows_in_no_other_column_of_the_reference_probe():
    """With floating columns its row's current finds other ways."""
    pressure_kPa = np.full((16, 26), 2.0)
    pressure_kPa[5, 7] = 10.0
    others = np.arange(26) != 7
    held, floating = (
        np.abs(errors(readout, pressure_kPa, FILM_OHM, 5.0)[:, others]).max()
        for readout in (REFERENCE, FLOATING)
    )
    assert held < 0.04 < floating

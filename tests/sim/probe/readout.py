"""What a resistive matrix's electronics make of its cells: nodal analysis, one row at a time.

A cell conducts in proportion to its pressure. While a row is read, its line is connected to ground and every
row is held at the amplifiers' reference through a resistor, so that the current into an amplifier comes
from one cell alone. What spoils that: resistance of the switches, hold resistors that give way, columns that
float, and the amplifiers' offsets. Units: V, A, ohm, S, kPa.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FULL_SCALE_KPA = 25.0
SUPPLY_V = 3.3
LEAK_S = 1e-9
"""Of a cell that nothing presses: a line of such cells has a voltage all the same."""


@dataclass(frozen=True)
class Readout:
    """The circuit between matrix and converter.

    Parameters
    ----------
    reference_V : float
        At the amplifiers' non-inverting inputs.
    row_switch_ohm : float
        Of the switch that connects the chosen row to ground.
    hold_ohm : float
        Between every row and the reference.
    column_switch_ohm : float, optional
        Of the multiplexer between the columns and their one amplifier, the other columns floating; None:
        every column has an amplifier of its own, which holds it at the reference.
    offset_V : float
        Largest input offset of an amplifier. Each column's is another one, evenly spread.
    """

    reference_V: float
    row_switch_ohm: float
    hold_ohm: float
    column_switch_ohm: float | None = None
    offset_V: float = 5e-4

    def feedback_ohm(self, film_ohm: float) -> float:
        """Feedback with which a cell at full scale, of `film_ohm`, lifts the output to the supply."""
        return (SUPPLY_V / self.reference_V - 1.0) * film_ohm

    def read(self, pressure_kPa: Floats, film_ohm: float) -> Floats:
        """Outputs of the amplifiers over the reference.

        Parameters
        ----------
        pressure_kPa : (rows, columns) array
        film_ohm : float
            Resistance of a cell at `FULL_SCALE_KPA`.

        Returns
        -------
        (rows, columns) array, V
        """
        cells = np.asarray(pressure_kPa, float) / (FULL_SCALE_KPA * film_ohm) + LEAK_S
        columns = cells.shape[1]
        offsets = np.linspace(-1, 1, columns)[np.arange(columns) * 7 % columns] * self.offset_V
        current = np.array([self._row(cells, row, offsets) for row in range(len(cells))])
        return self.feedback_ohm(film_ohm) * current

    def _row(self, cells: Floats, row: int, offsets: Floats) -> Floats:
        """Currents out of the amplifiers' inputs while `row` is read, (columns,): Kirchhoff's current law."""
        to_line = np.full(len(cells), 1.0 / self.hold_ohm)
        to_line[row] += 1.0 / self.row_switch_ohm
        driven = np.zeros(len(cells))
        driven[row] = -self.reference_V / self.row_switch_ohm
        into_rows = to_line + cells.sum(axis=1)
        if self.column_switch_ohm is None:
            lines = (driven + cells @ offsets) / into_rows
            return np.asarray((offsets - lines[:, None]) * cells).sum(axis=0)
        switch = 1.0 / self.column_switch_ohm
        currents = np.empty(cells.shape[1])
        for column, offset in enumerate(offsets):
            into_columns = cells.sum(axis=0)
            into_columns[column] += switch
            laws = np.block([[np.diag(into_rows), -cells], [-cells.T, np.diag(into_columns)]])
            fed = np.zeros(len(laws))
            fed[: len(cells)] = driven
            fed[len(cells) + column] = switch * offset
            currents[column] = switch * (offset - np.linalg.solve(laws, fed)[len(cells) + column])
        return currents


REFERENCE = Readout(reference_V=0.5, row_switch_ohm=10.0, hold_ohm=1000.0)
"""The reference probe (docs/howto/build-the-probe.md): two TMUX1208 for the rows, an amplifier a column."""

FLOATING = Readout(reference_V=0.25, row_switch_ohm=100.0, hold_ohm=1000.0, column_switch_ohm=100.0)
"""Its first draught: 74HC4067 on both sides, and one amplifier behind each column multiplexer."""


def errors(readout: Readout, pressure_kPa: Floats, film_ohm: float, calibrated_kPa: float) -> Floats:
    """Error of every cell after zero and gain are set, in the air and under a uniform pressure.

    Parameters
    ----------
    pressure_kPa : (rows, columns) array
    film_ohm : float
        Resistance of a cell at `FULL_SCALE_KPA`.
    calibrated_kPa : float
        The uniform pressure.

    Returns
    -------
    (rows, columns) array, kPa
    """
    zero = readout.read(np.zeros_like(pressure_kPa), film_ohm)
    uniform = readout.read(np.full_like(pressure_kPa, calibrated_kPa), film_ohm)
    gain = calibrated_kPa / (uniform - zero)
    return gain * (readout.read(pressure_kPa, film_ohm) - zero) - pressure_kPa

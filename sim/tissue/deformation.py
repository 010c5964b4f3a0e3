"""The tissue's shape under the probe: what the thesis draws in Figure 8. Units: mm, kPa."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.face_sensors import SENSORS_MM
from palpate.sim.tissue.geometry import geometry_of
from palpate.sim.tissue.mesh import TissueMesh
from palpate.sim.tissue.one_thread import one_blas_thread
from palpate.sim.tissue.run import StrokeRun
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.stroke import checked_positions

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Pressed:
    """One position of a stroke.

    Attributes
    ----------
    position_mm : float
        Of the probe's middle; the lump is at 0.
    nodes_mm : ndarray (N, 2)
        Where the mesh's nodes are now.
    face_mm : ndarray (n, 2)
        The probe's face.
    image_kPa : ndarray (16,)
        The tactile image, at `sensors_mm`.
    displacement_mm : float
    """

    position_mm: float
    nodes_mm: Floats
    face_mm: Floats
    image_kPa: Floats
    displacement_mm: float
    sensors_mm: Floats


def deformation(
    case: Case, positions_mm: Sequence[float], settings: Settings | None = None
) -> tuple[TissueMesh, list[Pressed]]:
    """Press at each position by itself: without friction the way there does not matter.

    Parameters
    ----------
    positions_mm : sequence of float
        Ascending, mm.

    Raises
    ------
    CaseError, StrokeError
        As `simulate`.
    """
    settings = settings or Settings()
    wanted = checked_positions(positions_mm)
    out = []
    with one_blas_thread():
        geometry = geometry_of(case, settings, float(wanted[0]), float(wanted[-1]))
        run = StrokeRun(case, settings, geometry)
        for at in map(float, wanted):
            state = run.press(at, None)
            felt = run.read(state, at)
            s = np.linspace(-14.0, 14.0, 141)
            face = np.column_stack((at + s, state.height + run.contact.shape.height(s)[0]))
            nodes = geometry.mesh.nodes_mm + state.u.reshape(-1, 2)
            out.append(Pressed(at, nodes, face, felt["images_kPa"], felt["displacement_mm"], SENSORS_MM))
    return geometry.mesh, out

"""The frames that the solver is asked about."""

import numpy as np

from palpate.inversion.asked import PRESS, Alike, Frames, Solves
from palpate.inversion.classes import ANYWHERE
from palpate.inversion.forward import FINE
from palpate.sim.tissue.frames import solve_frames
from palpate.sim.tissue.topology import Topology

_ALIKE, _NEARLY = Alike(1.2, 0.2, 0.3), Alike(1.0, 0.05, 0.05)


def a_stroke():
    """Pressed at -20 mm; on the way there and behind the lump forces are others."""
    before, behind = np.arange(-20.0, 0.5, 2.0), np.arange(-15.3, -1.0, 3.0)
    pressed = np.log([1.0, 2.0, 3.0, 4.0, 5.0])
    return Frames(
        np.concatenate([np.full(5, -20.0), before, behind]),
        np.concatenate([pressed, np.full(len(before), np.log(5.05)), np.full(len(behind), np.log(4.5))]),
        np.concatenate([np.full(5, PRESS), np.zeros(len(before), int), np.ones(len(behind), int)]),
    )


def test_of_frames_alike_one_does_and_of_a_press_the_greatest_forces_come_first():
    frames = a_stroke()
    along = frames.longest().unlike(_ALIKE)
    assert set(along.way) == {0, PRESS} and len(along.places_mm) == 11 + 3
    assert np.allclose(np.exp(along.ln_F[along.way == PRESS]), [3.0, 2.0, 1.0])
    others = frames.unlike(_NEARLY, along)
    assert (others.way == 1).sum() == 5 and np.allclose(np.exp(others.ln_F[others.way == PRESS]), [4.0])


def test_frames_carried_on_from_others_are_those_of_a_stroke_of_their_own():
    frames, theta = a_stroke(), ANYWHERE.column("mean")
    found = Solves(ANYWHERE, FINE)(theta, frames, _ALIKE)
    topology = Topology(ANYWHERE.case(theta), FINE, -21.0, 1.0)
    geometry = topology.geometry(ANYWHERE.case(theta))
    alone = solve_frames(
        ANYWHERE.case(theta), FINE, geometry, found.places_mm[-4:], found.forces_N_per_m[-4:]
    )
    assert np.allclose(found.displacement_mm[-4:], alone.displacement_mm, rtol=1e-3)
    apart = np.abs(found.images_kPa[-4:] - alone.images_kPa).max()
    assert apart < 5e-3 * alone.images_kPa.max()

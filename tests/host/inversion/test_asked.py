"""The frames that the solver is asked about, and where Newton's method begins at the next guess."""

import numpy as np

from palpate.inversion.asked import PRESS, Alike, Frames, Solves
from palpate.inversion.classes import ANYWHERE
from palpate.inversion.forward import FINE

_ALONG, _EACH = Alike(1.2, 0.2, 0.3), Alike(1.0, 0.05, 0.05)


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
    along = frames.longest().unlike(_ALONG)
    assert set(along.way) == {0, PRESS} and len(along.places_mm) == 11 + 3
    assert np.allclose(np.exp(along.ln_F[along.way == PRESS]), [3.0, 2.0, 1.0])
    others = frames.unlike(_EACH, along)
    assert (others.way == 1).sum() == 5 and np.allclose(np.exp(others.ln_F[others.way == PRESS]), [4.0])


def test_frames_carried_on_are_those_pressed_anew_for_less_work():
    frames, theta = a_stroke(), ANYWHERE.column("mean")
    later = theta + 0.05 * ANYWHERE.column("sd")
    led, anew = Solves(ANYWHERE, FINE), Solves(ANYWHERE, FINE)
    led(theta, frames, _ALONG, _EACH, True)
    found, other = (one(later, frames, _ALONG, _EACH, False) for one in (led, anew))
    assert np.array_equal(found.places_mm, other.places_mm)
    assert np.allclose(found.displacement_mm, other.displacement_mm, rtol=1e-3)
    assert np.abs(found.images_kPa - other.images_kPa).max() < 5e-3 * other.images_kPa.max()
    work = [one.run.newton.counts.factorisations for one in (found, other)]
    assert work[0] < 0.75 * work[1]

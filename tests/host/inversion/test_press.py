"""A press alone is inverted, by another face's array too; what it does not tell has wide intervals."""

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.cli.refine import lines_of
from palpate.errors import UsageError
from palpate.inversion.classes import ANYWHERE, under
from palpate.inversion.felt import FeltStroke, NotInvertible, felt_press
from palpate.inversion.forward import COARSE
from palpate.inversion.posterior import USUAL_MESH, Posterior
from palpate.inversion.press import invert_press
from palpate.inversion.under import forward_of
from palpate.link.face import Face, face_in_words
from palpate.sim.probe.noise import LEVELS
from palpate.sim.tissue import Case
from tests.host.inversion.world import press_of

FLAT = Face(math.inf, 2.0, 80.0)


def test_the_jacobian_of_a_padded_press_is_its_derivative():
    """Rows that are not measured, a padding tied to the fat's modulus, a lump beside the face's middle."""
    rng = np.random.default_rng(2)
    press = FeltStroke(
        rng.uniform(1, 8, (3, 16)), np.full(16, 26), np.zeros(3), np.zeros(3), np.zeros(3),
        np.array([-20.0, -10.0, 0.0]), 3, face=FLAT, measured=False,
    )  # fmt: skip
    of = under(FLAT, ANYWHERE, 12.0)
    posterior, forward = (
        Posterior(of, press, LEVELS["typical"], USUAL_MESH),
        forward_of(of, COARSE, [press]),
    )
    z = posterior.start(of.column("mean"), 9.0, 2.0)
    z[posterior.at["force"]] = np.log([2.0, 4.0, 6.0])

    def computed(z):
        return forward(z[posterior.at["tissue"]], posterior.places(z), posterior.forces(z))

    found = computed(z)
    A, B = posterior.jacobian(z, found, forward.slopes(found))
    step = 2e-4 * np.minimum(posterior.sd, 1.0) * rng.standard_normal(len(z))
    ends = [posterior.misfit(z + sign * step, computed(z + sign * step)) for sign in (-1, 1)]
    difference = (ends[1].data - ends[0].data).ravel() / 2
    assert np.abs(A @ step - difference).max() < 0.02 * np.abs(difference).max()
    assert np.allclose(B @ step, (ends[1].prior - ends[0].prior) / 2)
    assert posterior.measured == 3 * 16 and (found.images.shape, ends[0].data[:, -1].any()) == (
        (3, 16),
        False,
    )


@pytest.mark.parametrize(("face", "measured"), [(None, True), (FLAT, False)], ids=["own", "flat and padded"])
def test_a_press_over_a_lump_is_told_as_far_as_it_tells(face, measured):
    case = Case(12.0, 0.5, 10.0, 0.9, fat_stiffening=1.0, gland_stiffening=1.0)
    felt = replace(case, probe_radius_mm=math.inf, padding_mm_per_kPa=2 / 80) if face else case
    press = press_of(felt, 4, measured=measured, face=face)
    found = invert_press(press, LEVELS["typical"], "anywhere")
    assert found.fits and found.press and found.kind == "anywhere", found
    for name, true in (("d_mm", 12.0), ("depth_mm", 6.0), ("t_mm", 12.0), ("E_fat_kPa", 10.0)):
        value = found.values[name]
        assert value.low < true < value.high, (name, value)
    assert lines_of(found)[0].startswith("press 1: a lump; fits")


def test_what_is_no_press_is_said():
    def pressed(**changed):
        parts = {
            "pressure_kPa": np.linspace(0.5, 5, 20)[:, None, None] * np.ones((20, 16, 26)),
            "dead": np.zeros((16, 26), bool),
            "displacement_mm": np.zeros(20),
            "time_s": np.arange(20) / 40,
        }
        return felt_press(**(parts | changed))

    assert pressed().alone and not pressed().measured
    assert pressed(displacement_mm=np.linspace(0, 2, 20)).measured
    with pytest.raises(NotInvertible, match="press 0 is too quick"):
        pressed(pressure_kPa=np.full((20, 16, 26), 5.0))
    with pytest.raises(NotInvertible, match="row 1 has no live cell"):
        pressed(dead=np.arange(416).reshape(16, 26) // 26 == 1)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("radius=flat&padding=2mm", "a thickness and a modulus"),
        ("radius=2mm", "too sharp"),
        ("radius=4cm", "is no positive number of mm"),
        ("padding=2mm&modulus=80kPa", "say radius="),
        ("radius=flat&padding=2mm&modulus=0.08kPa", "check the units"),
        ("rows=16", "describes no face"),
        ("flat", "describes no face"),
    ],
)
def test_a_face_that_is_not_described_is_asked_for(words, said):
    assert face_in_words("radius=flat&padding=2mm&modulus=80kPa") == FLAT
    with pytest.raises(UsageError, match=said):
        face_in_words(words)


def test_zeros_and_dead_cells_are_no_end_of_a_lump():
    """Of a light press over a cylinder half were refused as over a ball: their zeros counted as shares."""
    rng = np.random.default_rng(1)
    rise = np.linspace(0.1, 0.9, 24)[:, None, None] * (1 + np.cos(np.linspace(-2, 2, 16)))[None, :, None]
    cells = rise * (1 + 0.02 * rng.standard_normal((16, 26))) + 0.1 * rng.standard_normal((16, 26))
    dead = np.zeros((16, 26), bool)
    dead[7, 3] = True
    parts = {"dead": dead, "displacement_mm": np.linspace(0, 2, 24), "time_s": np.arange(24) / 40}
    assert felt_press(cells, **parts).alone
    bulge = 1 + 0.2 * np.exp(-(((np.arange(26) - 12.5) / 4) ** 2))
    with pytest.raises(NotInvertible, match="changes across the stroke, as over a ball"):
        felt_press(cells * bulge, **parts)

"""Refined answers in a report: the estimate beside each, and the fitted stroke over the measured one."""

from pathlib import Path

import numpy as np
import pytest

from palpate.answer.fitted import Inverted, Laid, Value
from palpate.report import style
from palpate.report.refined_figures import figure, items, write_refined
from palpate.stroke.read import load_strokes
from tests.host.report.collisions import collisions

RECORDED = Path(__file__).parents[1] / "recording" / "before_the_press.mcap"


def laid(press, n=24):
    """Made-up frames, the first `press` of them before the probe moved."""
    rng = np.random.default_rng(3)
    place = np.concatenate([np.full(press, -40.0), np.linspace(-40, 40, n - press)])
    fitted = 3 + np.exp(-0.5 * ((place[:, None] + np.linspace(-11, 11, 16)) / 5) ** 2)
    noise = rng.normal(0, 0.02, fitted.shape)
    return Laid(place, press, fitted + noise, fitted, 1.6 + noise[:, 0], np.full(n, 1.6))


def answer(stroke):
    values = {"d_mm": Value(11.2, 10.6, 11.8), "E_kPa": Value(78.0, 66.0, None)}
    return Inverted(
        stroke, values, "anywhere", {"none": 0.0, "anywhere": 1.0}, 0.8, True, True, laid=(laid(4),)
    )


@pytest.mark.parametrize("n", [24, 6], ids=["stroke", "press"])
def test_the_figure_can_be_read(n):
    with style.look():
        assert collisions(figure(laid(min(n, 6), n))) == []


def test_the_residual_is_measured_less_fitted():
    stroke = laid(4)
    with style.look():
        image = figure(stroke).axes[2].collections[0]
    assert np.allclose(image.get_array().reshape(16, -1), (stroke.measured_kPa - stroke.fitted_kPa)[4:].T)


def test_the_probes_estimate_stands_beside_the_refined_one():
    (said,) = [one.estimate for one in load_strokes(RECORDED)][:1]
    (item,) = items({RECORDED: [answer(said.stroke)]})
    ((_, table),) = item.tables
    rows = table.set_index("").T.to_dict()
    assert rows["Diameter"]["refined"] == "11.2 mm (10.6 to 11.8)"
    assert rows["Diameter"]["probe"].startswith(f"{said.outputs['d_mm']['value']:.1f} mm (")
    assert rows["Lump's modulus"] == {"probe": "not told", "refined": "78.0 kPa (over 66.0)"}
    assert "It fits." in item.caption and "anywhere 100%" in item.caption and "none" not in item.caption


def test_what_does_not_fit_and_what_was_not_refined_is_said(tmp_path):
    ill = Inverted(
        2, answer(2).values, "anywhere", {"anywhere": 1.0}, 2.1, why="two lumps would", laid=(laid(4),)
    )
    page = write_refined(
        tmp_path, {RECORDED: [ill, Inverted(3, problem="stroke 3 is too short")]}
    ).read_text()
    assert "It does not fit: two lumps would. Believe none of its numbers." in page
    assert "Not refined: stroke 3 is too short." in page
    assert page.count("data:image/png;base64,") == 1

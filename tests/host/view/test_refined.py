"""The forward model's answer beside the probe's: first that it is on its way, then what came of it."""

import numpy as np
import pytest
from playwright.sync_api import expect

from palpate import EmulatedProbe, models
from palpate.answer.fitted import Inverted, Laid, Value
from palpate.link import emulator_model as emulator
from palpate.link.session import recorded
from palpate.sim.tissue import Case
from palpate.stroke.answered import Answered
from palpate.view.notices import Refined
from palpate.view.refined import refined_card, refining_recorded
from palpate.view.replay import ReplaySource
from tests.host.view.synthetic import Bump, SyntheticSource
from tests.host.view.waiting import PATIENCE_S


def laid():
    """A stroke whose fit leaves one thing: row 13 is 0.3 kPa too high in the last third of the way."""
    place = np.concatenate([np.full(3, -40.0), np.linspace(-40, 40, 31)])
    fitted = 3 + np.exp(-0.5 * ((place[:, None] + np.linspace(-11, 11, 16)) / 5) ** 2)
    measured = fitted + 0.3 * np.outer(place > 15, np.arange(16) == 12)
    return Laid(place, 3, measured, fitted, np.ones(34), np.ones(34))


FITTED = Inverted(
    1,
    {
        "d_mm": Value(12.3, 11.8, 12.9),
        "depth_mm": Value(6.2, 6.0, 6.5),
        "E_kPa": Value(140.0, 96.0, None),
        "t_mm": Value(12.4, 12.0, 12.9),
        "E_fat_kPa": Value(9.8, 9.4, 10.3),
    },
    kind="anywhere",
    classes={"none": 0.0, "border": 0.2, "anywhere": 0.8},
    chi2=0.93,
    fits=True,
    settled=True,
    centre_mm=1.0,
    laid=(laid(),),
)  # fmt: skip


class Beside:
    """Tells the page of each stroke that it is being refined; `answer` then says what came of the last."""

    def __call__(self, emit, _):
        def both(event):
            emit(event)
            if isinstance(event, Answered):
                self.answer = lambda card: emit(Refined(event.estimate.time_us, card))
                self.answer({"working": True})

        return both


@pytest.fixture
def seen(viewer, open_page):
    """The page of one stroke that is being refined, and what tells it the answer."""
    beside = Beside()
    page = open_page(viewer(SyntheticSource([Bump()], seconds=0.8, rest=0.0, limit=1), beside=beside))
    expect(page.locator("#refined")).to_contain_text("Refining")
    return page, lambda card: beside.answer(card)


def test_the_fitted_numbers_come_below_the_probes_own(seen):
    page, tell = seen
    tell(refined_card(FITTED))
    refined = page.locator("#refined")
    expect(refined.locator(".verdict")).to_have_text("Fitted: a lump")
    expect(refined.locator('[data-key="d_mm"]')).to_contain_text("12.3 mm 11.8 to 12.9")
    expect(refined.locator('[data-key="E_kPa"]')).to_contain_text("over 96.0")
    expect(refined.locator(".foot")).to_have_text("Odds: border 20%, anywhere 80%. Misfit 0.93.")
    expect(page.locator('#card [data-key="d_mm"]')).to_contain_text("10.0")
    page.reload()
    expect(refined.locator(".verdict")).to_have_text("Fitted: a lump")


PAINTED = """
(canvas) => {
  const { width, height } = canvas;
  const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
  const probe = document.createElement("i");
  probe.style.color = "var(--fit)";
  document.body.append(probe);
  const wanted = getComputedStyle(probe).color.match(/[0-9]+/g).map(Number);
  probe.remove();
  const at = [];
  for (let n = 0; n < width * height; n++)
    if (wanted.every((v, k) => Math.abs(data[4 * n + k] - v) < 3) && data[4 * n + 3] > 250)
      at.push([(n % width) / width, Math.floor(n / width) / height]);
  return at;
}
"""
"""Where on a canvas the colour of the fit is, as shares of its width and height."""


def test_the_fitted_stroke_lies_over_the_measured_one(seen):
    """Curves of rows; below them an image of what the fit leaves, where it leaves it."""
    page, tell = seen
    expect(page.locator("#fitted")).to_be_hidden()
    tell(refined_card(FITTED))
    expect(page.locator("#fitted p")).to_have_text(
        "row 1 row 6 row 11 row 16 measured (points) and fitted (lines); "
        "below, measured less fitted, up to 0.30 kPa"
    )
    curves, residual = page.locator("#fitted canvas").all()
    assert len(curves.evaluate(PAINTED)) > 100
    left = np.array(residual.evaluate(PAINTED))
    assert left[:, 0].min() > 0.6 and left[:, 1].max() < 0.4
    page.reload()
    expect(page.locator("#fitted")).to_be_visible()
    tell({"problem": "Not refined: no press was recorded before it."})
    expect(page.locator("#fitted")).to_be_hidden()


def test_what_does_not_fit_and_what_cannot_be_fitted_is_said(seen):
    page, tell = seen
    tell(refined_card(Inverted(1, FITTED.values, "anywhere", {"anywhere": 1.0}, 2.1, why="two lumps would")))
    expect(page.locator("#refined .say")).to_have_text(
        "It does not fit: two lumps would. Believe none of its numbers."
    )
    expect(page.locator("#refined .foot")).to_contain_text("had not come to rest")
    tell({"problem": "Not refined: no press was recorded before it."})
    expect(page.locator("#refined")).to_have_text("Not refined: no press was recorded before it.")


@pytest.mark.long
def test_a_recorded_stroke_is_fitted_and_shown(viewer, open_page, tmp_path):
    path = tmp_path / "visit.mcap"
    case = Case.from_code("d12h07e20f09")
    emulated = EmulatedProbe.over(
        case, strokes=1, public_key=emulator.public_key(), model=emulator.image(models.FIELD)
    )
    with emulated as probe, recorded(probe.port, path) as host:
        list(host.stream(strokes=1))
    with refining_recorded(path) as beside:
        page = open_page(viewer(ReplaySource(path), "replay", beside=beside))
        page.locator("#stroke-1").click()
        expect(page.locator("#refined .verdict")).to_contain_text("Fitted", timeout=10_000 * PATIENCE_S)

"""The numbers that the page shows of the present frame."""

import itertools

import numpy as np
import pytest
from playwright.sync_api import expect

from firmware_py import geometry
from palpate.view.notices import LinkChanged, LinkState
from tests.host.view import synthetic


class Pressed:
    """A probe that lies under an even pressure."""

    name = "Pressed"

    def __init__(self, kPa):
        self.kPa = kPa

    def run(self, emit, stop):
        emit(LinkChanged(LinkState.CONNECTED, "Connected.", synthetic.DEVICE))
        for seq in itertools.count():
            emit(
                synthetic.frame(seq, seq / 20, 0.0, 2.0, np.full((geometry.ROWS, geometry.COLUMNS), self.kPa))
            )
            if stop.wait(0.05):
                return


@pytest.mark.parametrize("kPa", [5.0, 10.0])
def test_the_force_that_the_page_shows_is_the_pressure_on_the_face(viewer, open_page, kPa):
    """Newtons per metre of the face's width: kPa times its length in mm. It was 26/16 of that, unnoticed."""
    page = open_page(viewer(Pressed(kPa)))
    length_mm = geometry.ROWS * geometry.PITCH_UM / 1000
    expect(page.locator("#now-force")).to_have_text(f"{kPa * length_mm:.0f}")
    expect(page.locator("#now-peak")).to_have_text(f"{kPa:.1f}")

"""The layer that a lump lies in, and its size where its stiffness is not known: live and from a recording."""

from __future__ import annotations

import math

import pytest

from palpate import models
from palpate.sim.probe.over_lump import strokes_over
from palpate.sim.tissue import Case
from palpate.stroke.read import load_strokes
from palpate.stroke.replay import replay
from tests.host.across.test_across import holds, streamed
from tests.host.conftest import emulated

__all__ = ["emulated"]

IN_FAT = "d09h04e20f06_t20"
IN_GLAND = "d14h06e50f05_g28_t5"


@pytest.fixture(scope="module", params=[(IN_FAT, "in the fat"), (IN_GLAND, "in the gland")])
def lump(request):
    """A case, where it lies, and what a probe's sensors read of a stroke over it."""
    code, place = request.param
    return Case.from_code(code), place, *strokes_over(code, "typical", 3, 60, 1, press=True)


@pytest.mark.timeout(300)
def test_a_reader_is_told_the_layer_the_depth_and_which_size_goes_with_which_stiffness(
    palpate, emulated, tmp_path, lump
):
    case, place, streams, calibration = lump
    ((stroke,), visit) = streamed(palpate, emulated, tmp_path, streams, calibration, models.ANYWHERE)
    said = stroke["layer"]
    assert stroke["across"] is None
    other = "in the gland" if place == "in the fat" else "in the fat"
    assert said["place"] in (place, "unsure") and said["odds"][other] < 0.05 < said["odds"][place]
    assert sum(said["odds"].values()) == pytest.approx(1)
    assert holds(said["in_fat"], (case.t_mm - case.depth_mm) / case.d_mm)
    assert stroke["depth_from"] == "layer" and holds(stroke["depth_mm"], case.depth_mm)
    assert stroke["depth_mm"]["high"] < 4 * stroke["depth_mm"]["low"], "the tie's were 0.3 and 29 mm"
    soft, hard = said["size"]["if"]
    assert hard["d_mm"] < soft["d_mm"], "soft and large looks like hard and small"
    assert math.isclose(
        stroke["depth_mm"]["value"], stroke["d_mm"]["value"] * stroke["h"]["value"], rel_tol=1e-4
    )
    status, out, _ = palpate("replay", visit)
    (line,) = (line for line in out.splitlines() if "lump depth" in line)
    assert "({low:.3f} to {high:.3f}, ".format(**stroke["depth_mm"]) in line
    assert status == 0 and place in out and "× fat" in out
    across_the_border = said["in_fat"]["low"] < 1 and said["in_fat"]["high"] > 0
    assert ("of its height in fat" in out) == across_the_border
    (again,) = replay(visit)
    assert again.identical and again.told.layer.as_dict() == said
    replayed = again.as_dict()
    assert replayed["layer"] == said
    assert replayed["estimate"]["depth_mm"] == replayed["replayed"]["depth_mm"] == stroke["depth_mm"]
    (shown,) = load_strokes(visit)
    card = shown.summary()["card"]
    assert card["layer"]["place"] == said["place"]
    (depth,) = (row for row in card["rows"] if row["key"] == "depth_mm")
    assert [depth[part] for part in ("value", "low", "high")] == list(stroke["depth_mm"].values())


def test_a_model_of_lumps_on_the_border_tells_no_layer(palpate, emulated, tmp_path, lump):
    _, _, streams, calibration = lump
    ((stroke,), _) = streamed(palpate, emulated, tmp_path, streams, calibration, models.FIELD)
    assert stroke["layer"] is None and stroke["depth_from"] == "tie"


def test_a_lump_with_a_fat_of_its_own_thickness_has_the_model_that_tells_where_it_lies():
    assert models.suited_to(Case.from_code(IN_FAT)) == models.ANYWHERE
    assert models.suited_to(Case.from_code("d10h08e20f10")) == models.FIELD

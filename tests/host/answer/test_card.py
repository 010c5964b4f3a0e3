"""What the card says of each kind of answer, and what it does not say."""

from dataclasses import replace

import pytest

from firmware_py import messages, outputs, status
from palpate.answer.card import card, verdict
from palpate.answer.layers import LumpLayer
from palpate.answer.told import AcrossStroke, Told
from palpate.wire.events import Estimate
from tests.host.link import wires
from tests.host.link.test_parser import parse

LUMP = {
    "d_mm": (12.0, 11.0, 13.0),
    "h": (0.5, 0.4, 0.6),
    "t_mm": (12.0, 11.5, 12.5),
    "E_inv23": (0.1, 0.05, 0.2),
}
ACROSS = AcrossStroke(0.9, (14.0, 12.0, 16.0), (-2.0, -4.0, 0.0))
LAYER = LumpLayer(
    0.9, "in the fat", {"in the fat": 0.9, "at the border": 0.08, "in the gland": 0.02}, (1.3, -0.2, 1.9),
    (7.0, 5.0, 9.0), ((8.0, 11.0), (None, 9.0)), 0.05, True,
)  # fmt: skip


def answered(
    *, lump=True, in_domain=True, force_out=False, calibrated=True, state=status.OK, hard=True, invalid=False
):
    _, events, _ = parse(wires.started() + wires.estimate(1, **LUMP))
    (one,) = (event for event in events if isinstance(event, Estimate))
    flags = lump * outputs.LUMP | in_domain * outputs.IN_DOMAIN | force_out * outputs.FORCE_OUT
    flags |= outputs.HARD if hard else outputs.SOFT
    flags |= invalid * outputs.INVALID
    damage = 0 if calibrated else messages.DAMAGED_CALIBRATION
    return replace(one, flags=flags, damage=damage, status=state)


def keys(said):
    return [row["key"] for row in said["rows"]]


def test_a_lump_has_all_its_numbers_with_their_intervals_and_units():
    said = card(answered(), Told(across=ACROSS))
    assert said["kind"] == "lump" and said["title"] == "Lump found" and said["level"] == 0.9
    assert keys(said)[:4] == ["d_mm", "width_mm", "depth_mm", "place_mm"] and keys(said)[-1] == "F_N_per_m"
    rows = {row["key"]: row for row in said["rows"]}
    assert (rows["d_mm"]["value"], rows["d_mm"]["low"], rows["d_mm"]["high"]) == (12.0, 11.0, 13.0)
    assert rows["depth_mm"]["value"] == pytest.approx(6.0) and rows["depth_mm"]["beside"]["value"] == 0.5
    labels = [rows[key]["label"] for key in ("d_mm", "depth_mm", "t_mm", "E_fat_kPa", "F_N_per_m")]
    assert labels == ["Diameter", "Depth", "Tissue thickness", "Stiffness of the fat", "Force"]
    assert (rows["width_mm"]["low"], rows["place_mm"]["high"]) == (12.0, 0.0)
    assert {rows[key]["unit"] for key in ("d_mm", "t_mm", "place_mm")} == {"mm"}
    assert rows["F_N_per_m"]["unit"] == "N/m" and said["model_id"] == b"MODEL-ID".hex()
    assert said["E_ratio"]["value"] == pytest.approx(0.1**-1.5) and "× fat" in said["stiffness_text"]
    assert said["layer"] is None and not said["reference"]
    assert said["notice"] == "Research use, not a diagnosis."
    assert said["hardness"] == "hard" and said["hardness_text"].startswith("hard")
    assert card(answered(hard=False))["hardness_text"].startswith("soft")
    assert "kPa" in card(answered(), fat_kPa=10.0)["stiffness_text"]


def test_a_layer_is_said_with_its_own_depth_and_its_share_within_the_lump():
    said = card(answered(), Told(layer=LAYER))
    (depth,) = (row for row in said["rows"] if row["key"] == "depth_mm")
    assert (depth["value"], depth["low"], depth["high"]) == (7.0, 5.0, 9.0)
    assert said["layer"]["text"] == "in the fat (90 %)" and "11.0 mm if 8" in said["layer"]["sizes"]
    assert (said["layer"]["value"], said["layer"]["low"], said["layer"]["high"]) == (1.0, 0.0, 1.0)
    assert card(answered(), Told(layer=replace(LAYER, worth_saying=False)))["layer"]["sizes"] == ""


@pytest.mark.parametrize(
    ("changes", "kind", "numbers"),
    [
        ({"in_domain": False}, "outside", True),
        ({"lump": False}, "none", None),
        ({"lump": False, "in_domain": False}, "none", None),
        ({"force_out": True}, "force", False),
        ({"force_out": True, "lump": False}, "force", False),
        ({"state": status.NO_MODEL}, "no_model", False),
        ({"state": status.NO_MODEL, "calibrated": False}, "no_model", False),
        ({"calibrated": False}, "uncalibrated", False),
        ({"calibrated": False, "force_out": True}, "uncalibrated", False),
        ({"state": status.TOO_SHORT}, "unread", False),
    ],
)
def test_what_is_wrong_with_a_stroke_comes_before_what_is_in_it(changes, kind, numbers):
    """numbers: all; those that mean something without a lump (False); none at all (None)."""
    said = card(answered(**changes), Told(across=ACROSS, layer=LAYER))
    assert said["kind"] == kind and said["text"] and said["title"]
    assert said["notice"] == card(None)["notice"] == "Research use, not a diagnosis."
    assert (said["hardness"] is not None) == bool(numbers) == (said["layer"] is not None)
    assert (said["E_ratio"] is not None) == bool(numbers) == bool(said["stiffness_text"])
    if numbers:
        assert {"d_mm", "depth_mm", "width_mm"} < set(keys(said))
    else:
        assert keys(said) == ([] if numbers is None else ["F_N_per_m"])


def test_no_answer_says_so_and_nothing_else():
    said = card(None)
    assert said["kind"] == "missing" and not said["rows"] and said["level"] is None and said["model_id"] == ""


def test_an_answer_names_its_model_and_what_became_of_the_reference_press():
    named = answered()
    assert card(replace(named, model_id=bytes(8)))["model_id"] == "", "no model has only zeros"
    flags = (outputs.REFERENCE, outputs.REFERENCE_OFF, 0)
    texts = [card(replace(named, flags=named.flags | flag))["reference"] for flag in flags]
    assert texts[0] == "With the reference press." and "left out" in texts[1] and not texts[2]


def test_too_much_and_too_little_force_are_told_apart():
    out = answered(force_out=True)
    assert verdict(out, force_low=True) == "force_low" and verdict(out, force_high=True) == "force_high"
    assert verdict(out) == "force"
    assert verdict(answered(), force_low=True) == verdict(answered(), force_high=True) == "lump"


def test_why_a_stroke_lies_outside_is_said_of_such_a_stroke_alone():
    why = Told(outside=("two_lumps",))
    assert "two lumps" in card(answered(in_domain=False), why)["text"]
    assert "two lumps" not in card(answered(), why)["text"]
    assert "Perhaps" not in card(answered(in_domain=False), Told())["text"]


def test_a_stroke_that_could_not_be_read_says_why():
    said = card(answered(state=status.TOO_SHORT))
    why = "The stroke is too short: stroke on, 24 mm to either side of the lump. Stroke again."
    assert said["text"] == why
    assert "either side" not in card(answered(invalid=True))["text"]
    for other in (answered(state=status.TOO_SHORT, calibrated=False), answered()):
        assert "either side" not in card(other)["text"]

"""A press beside the lump tells the probe more of the tissue, and joins every stroke of the visit."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from palpate.errors import CommandRefused, ImageRefused
from palpate.link.flash import flash
from palpate.link.session import recorded
from palpate.model_export.exporter import export
from palpate.sim.probe.over_lump import reference_beside, strokes_over
from palpate.stroke.replay import replay
from palpate.wire.events import Estimate
from tests import reference_model
from tests.host.probes import LUMP, connect

FAT_KPA, FAT_MM = 10.0, 12 * (0.7 + 0.5)
"""Of the lump's tissue."""


@pytest.fixture(scope="module")
def beside():
    return reference_beside(LUMP, "typical", 1)


@pytest.fixture(scope="module")
def pressed():
    """A stroke with its press before it, and the calibration."""
    return strokes_over(LUMP, "typical", 1, 40, 1, press=True)


@pytest.fixture(scope="module")
def image(real_key_dir):
    return export(reference_model.model(), real_key_dir)[0]


@pytest.fixture
def visit(emulated, beside, pressed, image):
    """Makes probes whose hand presses this first, and then strokes."""

    def make(runtime="cpython", first=beside, **options):
        strokes, calibration = pressed
        given = {"strokes": [first, *strokes], "calibration": calibration, "model": image} | options
        return emulated(runtime, **given)

    return make


def estimate(client) -> Estimate:
    return next(event for event in client.stream(1) if isinstance(event, Estimate))


@pytest.mark.parametrize("runtime", ["cpython", "micropython"])
def test_the_reference_tells_the_tissue_and_joins_the_strokes_until_it_is_cleared(visit, runtime):
    with visit(runtime) as probe, connect(probe) as client:
        assert "takes_reference" in client.identity.capabilities
        assert client.reference() is None
        alone = estimate(client)
        told = client.take_reference()
        assert told.E_fat_kPa == pytest.approx(FAT_KPA, rel=0.15)
        assert told.t_mm == pytest.approx(FAT_MM, rel=0.25)
        assert client.reference() == told
        assert "holds_reference" in client.refresh_identity().capabilities
        together = estimate(client)
        assert (alone.reference, together.reference) == ("", "used")
        assert together.values != alone.values
        client.clear_reference()
        assert client.reference() is None
        assert estimate(client).numbers == alone.numbers


def test_it_is_forgotten_with_the_power_and_with_another_zero(visit):
    with visit() as probe:
        with connect(probe) as client:
            client.take_reference()
            client.forget_calibration()
            assert client.reference() is None
            client.take_reference()
        probe.cut_power()
        probe.start()
        with connect(probe) as client:
            assert client.reference() is None


def test_a_model_that_is_refused_leaves_the_live_one_with_its_reference(visit, real_key_dir):
    """A new model is tried with the live one's tables out of its way, and they are read again."""
    old = export(reference_model.model(), real_key_dir, counter=1)[0]
    with visit() as probe, connect(probe) as client:
        told = client.take_reference()
        live = client.identity.model_id
        with pytest.raises(ImageRefused, match="older than"):
            flash(client, old)
        assert client.refresh_identity().model_id == live
        assert client.reference() == told
        assert estimate(client).reference == "used"


def test_a_reference_of_another_person_is_told_with_the_estimate_and_left_out(visit):
    other = reference_beside("d05h03e10f05_G3_g20", "typical", 1)
    with visit(first=other) as probe, connect(probe) as client:
        alone = estimate(client)
        client.take_reference()
        told = estimate(client)
    assert told.reference == "unlike"
    assert told.values == alone.values


def held_at(stream, **changes):
    """The same frames with places or displacements changed."""
    return replace(stream, **changes)


def moved_along(stream):
    n = len(stream.packed)
    return held_at(stream, positions_um=stream.positions_um + np.linspace(0, 15_000, n).astype(int))


def light(stream):
    """A sixth of the force, so that the fat is hardly pressed in."""
    return reference_beside(LUMP.replace("f09", "f0.15"), "typical", 1)


def only(stream, keep):
    """Some of its frames."""
    return held_at(stream, packed=[stream.packed[k] for k in keep], positions_um=stream.positions_um[keep],
                   displacements_um=stream.displacements_um[keep])  # fmt: skip


def touching(stream):
    return only(stream, np.arange(60, len(stream.packed)))


def quick(stream):
    """Pressed and lifted within a tenth of a second."""
    return only(stream, np.r_[0:42, 52, 60, 66, 72 : len(stream.packed)])


def touched_again(stream):
    """Before a second in the air was over."""
    return only(stream, np.r_[0:80, 40:70, 70 : len(stream.packed)])


@pytest.mark.parametrize(
    ("spoil", "words"),
    [(moved_along, "moved along the skin"), (touching, "is in contact"), (quick, "too light or quick"),
     (touched_again, "in the air for one"), (light, "too light or quick")],
)  # fmt: skip
def test_a_press_that_will_not_do_is_said_and_the_reference_before_stays(visit, beside, spoil, words):
    with visit() as probe, connect(probe) as client:
        before = client.take_reference()
        probe.set_strokes([spoil(beside)])
        with pytest.raises(CommandRefused, match=words):
            client.take_reference()
        assert client.reference() == before
        assert not client.statistics()["estimates"]


def test_a_model_that_was_told_its_tissue_takes_none(visit, images, public_key):
    with visit(model=images[0], public_key=public_key) as probe, connect(probe) as client:
        assert "takes_reference" not in client.identity.capabilities
        with pytest.raises(CommandRefused, match="takes no reference"):
            client.take_reference()


@pytest.mark.parametrize("level", ["typical", "real"])
def test_a_recording_replays_with_the_reference_that_was_taken_before_it_began(level, visit, tmp_path):
    """At the second level two cells hang, in the reference, in the press and in the stroke."""
    beside = reference_beside(LUMP, level, 1)
    strokes, calibration = strokes_over(LUMP, level, 1, 40, 1, press=True)
    with visit("micropython", strokes=[beside, *strokes], calibration=calibration) as probe:
        with connect(probe) as client:
            client.take_reference()
        with recorded(probe.port, tmp_path / "visit.mcap") as client:
            said = estimate(client)
            client.clear_reference()
            estimate(client)
    strokes = list(replay(tmp_path / "visit.mcap"))
    assert [stroke.probe.reference for stroke in strokes] == ["used", ""]
    assert all(stroke.identical for stroke in strokes)
    assert strokes[0].host.numbers == said.numbers


def test_the_command_takes_shows_and_clears_it(visit, palpate):
    with visit() as probe:
        status, out, err = palpate("reference", "--port", probe.port)
        assert status == 0 and "straight down" in err and "kPa" in out
        status, out, _ = palpate("reference", "--show", "--json", "--port", probe.port)
        told = json.loads(out)
        assert told["held"] and told["E_fat_kPa"] == pytest.approx(FAT_KPA, rel=0.15)
        status, out, _ = palpate("reference", "--clear", "--port", probe.port)
        assert status == 0 and out == "the probe keeps no reference press\n"
        assert palpate("reference", "--clear", "--show", "--port", probe.port)[0] == 2

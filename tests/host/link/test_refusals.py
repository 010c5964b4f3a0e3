"""Images that a probe must not take, sent over the real protocol while it streams."""

import struct

import pytest

from firmware_py import messages, status
from firmware_py import model_image as image_format
from palpate.errors import ImageRefused
from palpate.link.flash import flash
from palpate.model_export.exporter import export
from palpate.model_export.signing import keys
from palpate.wire.events import Estimate, Frame
from tests.host.probes import FRAMES, connect
from tests.waiting import PATIENCE_S

BAD = "its signature does not fit"
UNWANTED = {
    "unsigned": (status.BAD_SIGNATURE, BAD),
    "signed with zeros": (status.BAD_SIGNATURE, BAD),
    "signed by another key": (status.BAD_SIGNATURE, "another key signed it"),
    "replayed": (status.TOO_OLD, "it is older than a model the probe has held"),
}


@pytest.fixture(scope="module")
def unwanted(specs, images, key_dir, tmp_path_factory):
    """The images by name; all but the replayed one have a counter that the probe would take."""
    other = tmp_path_factory.mktemp("other") / "key"
    keys.generate(other)
    stranger = export(specs[0], other, counter=keys.MAX_COUNTER)[0]
    own = export(specs[0], key_dir, counter=keys.MAX_COUNTER)[0]
    (size,) = struct.unpack_from("<I", own, 8)
    assert image_format.HEAD_SIZE < size < len(own)
    return {
        "unsigned": own[:size],
        "signed with zeros": own[:size] + bytes(len(own) - size),
        "signed by another key": stranger,
        "replayed": images[0],
    }


@pytest.mark.parametrize("what", UNWANTED)
def test_it_is_refused_by_name_while_the_probe_streams(emulated, images, unwanted, what):
    code, words = UNWANTED[what]
    with connect(emulated("micropython", repeat=True)) as probe:
        flash(probe, images[0])
        live = flash(probe, images[1]).model_id
        probe.start_stream()
        events = probe.events(PATIENCE_S)
        next(e for e in events if isinstance(e, Frame))
        with pytest.raises(ImageRefused, match=words) as refusal:
            flash(probe, unwanted[what])
        assert refusal.value.status == code
        assert "the model it had stays" in str(refusal.value)
        assert probe.refresh_identity().model_id == live
        assert probe.read_back(messages.READ_MODEL) == images[1]
        # without a new start: frames go on, and the next strokes are answered by the old model
        seen = []
        for event in events:
            seen.append(event)
            if sum(isinstance(e, Estimate) for e in seen) == 2:
                break
        assert {e.model_id.hex() for e in seen if isinstance(e, Estimate)} == {live}
        assert sum(isinstance(e, Frame) for e in seen) > FRAMES
        assert probe.identity.boots == 1


def test_a_probe_takes_another_key_from_the_one_it_knows_and_from_no_other(
    emulated, images, specs, key_dir, tmp_path
):
    new = keys.generate(tmp_path / "new")
    handed_over = keys.succeed(key_dir, new)
    with connect(emulated("micropython")) as probe:
        live = flash(probe, images[0]).model_id
        assert flash(probe, handed_over).model_id == live
        with pytest.raises(ImageRefused, match="another key signed it"):
            flash(probe, images[1])
        of_new = export(specs[1], tmp_path / "new", counter=keys.MAX_COUNTER)[0]
        assert flash(probe, of_new).model_id != live

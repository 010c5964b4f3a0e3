"""Images that a probe must not take, sent over the real protocol while it streams."""

import struct

import pytest

from firmware_py import image as image_format
from firmware_py import messages, status
from host.errors import ImageRefused
from host.link.events import Estimate, Frame
from host.link.flash import flash
from model_export import keys
from model_export.exporter import export
from tests.host.conftest import FRAMES, connect
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
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PALPATE_STATE", str(tmp_path_factory.getbasetemp() / "state"))
        other = tmp_path_factory.mktemp("other") / "key"
        keys.generate(other, height=5, width=8)
        stranger = export(specs[0], other, counter=900)[0]
        own = export(specs[0], key_dir, counter=900)[0]
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

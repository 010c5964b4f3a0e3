"""Frames without length or check sum: found again whatever stands in them."""

import numpy as np
import pytest

from palpate.sources.framing import Framing

MARK = b"\xaa\x55"
LENGTH = 258


def frames(n, rng):
    """Frames full of marks: a third of their bytes are of one."""
    cells = rng.choice(np.array([0xAA, 0x55, *range(4)], np.uint8), (n, LENGTH - 2))
    return [MARK + each.tobytes() for each in cells]


@pytest.mark.parametrize("piece", [1, 64, 1000])
def test_marks_inside_a_payload_and_half_a_frame_cost_no_frame(piece):
    sent = frames(60, np.random.default_rng(piece))
    data = sent[0][100:] + b"".join(sent)
    framing, found = Framing(LENGTH, MARK), []
    for at in range(0, len(data), piece):
        found += framing.feed(data[at : at + piece])
    assert found[-50:] == sent[-50:]
    assert framing.slips <= 3  # a false pair of marks may hold for a frame


def test_lost_bytes_cost_the_frame_that_they_are_of():
    sent = frames(40, np.random.default_rng(1))
    framing = Framing(LENGTH, MARK)
    assert framing.feed(b"".join(sent[:20]) + sent[20][:77]) == sent[:20]
    found = framing.feed(b"".join(sent[21:]))
    assert found[-15:] == sent[-15:] and framing.slips >= 1


def test_the_end_of_a_frame_may_be_marked_instead():
    rng = np.random.default_rng(2)
    sent = [rng.normal(0, 100, 20).astype("<f4").tobytes() + b"\r\n" for _ in range(20)]
    framing = Framing(82, b"\r\n", at=80)
    assert framing.feed(b"".join(sent)[5:])[-15:] == sent[-15:]


def test_noise_gives_next_to_nothing():
    noise = np.random.default_rng(3).integers(0, 256, 1 << 16, dtype=np.uint8).tobytes()
    assert len(Framing(LENGTH, MARK).feed(noise)) <= 1

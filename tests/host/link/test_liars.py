"""Probes that lie: their numbers are shown or refused in a sentence, and none is followed for ever."""

import json
import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py import feature_names, messages, outputs, wire
from palpate import models, spans
from palpate.answer.card import card
from palpate.answer.told import told
from palpate.cli.ports import estimate_dict, estimate_lines
from palpate.console import plain
from palpate.errors import Contradiction, FlashError, PortBusy
from palpate.link.flash import flash
from palpate.link.probe import Probe
from palpate.link.transport import open_transport
from palpate.recording.convert import convert
from palpate.stroke.replay import replay
from palpate.wire.events import Estimate
from tests.host.link import wires
from tests.host.recording.recorded import record

NUMBER = st.one_of(st.sampled_from([0, 1, -1, 10**6, 2**31 - 1, -(2**31)]), st.integers(-(2**31), 2**31 - 1))
VALUES = st.tuples(*[NUMBER] * outputs.VALUES)
ORDERED = st.lists(st.integers(1, 2**31 - 1), min_size=3, max_size=3).map(sorted)
PLAUSIBLE = st.lists(ORDERED, min_size=len(outputs.NAMES), max_size=len(outputs.NAMES)).map(
    lambda rows: tuple(v for low, value, high in rows for v in (value, low, high))
)


@settings(deadline=None)
@given(st.one_of(VALUES, PLAUSIBLE), st.integers(0, 255), st.sampled_from([0, -5, 77]), st.floats(0.1, 1e3))
def test_whatever_numbers_an_estimate_has_it_is_shown(values, flags, status, fat_kPa):
    """A packet whose checksum was right ended `stream` ("math domain error"), `replay` and `convert`."""
    estimate = Estimate(0, 1, 1, status, flags, 0, 900, 400, b"MODEL-ID", 10, 0, 10, 0, 5, values)
    for fat in (None, fat_kPa):
        assert estimate_lines(estimate, fat)
        json.dumps(plain(estimate_dict(estimate, fat)), allow_nan=False)
        json.dumps(plain(card(estimate, fat_kPa=fat)), allow_nan=False)


@settings(deadline=None, max_examples=30)
@given(st.sampled_from([models.FIELD, models.ANYWHERE, models.BALLS]), VALUES, st.integers(0, 2**32 - 1))
def test_whatever_features_it_sends_nothing_that_follows_ends_the_program(name, values, seed):
    features = np.random.default_rng(seed).integers(-(2**29), 2**29, len(feature_names.NAMES))
    answer = [tuple(v / 1e6 for v in values[3 * k : 3 * k + 3]) for k in range(len(outputs.NAMES))]
    told(SPECS[name], features.tolist(), list(range(26)), answer, in_domain=False)


SPECS = {name: models.load(name) for name in (models.FIELD, models.ANYWHERE, models.BALLS)}


def test_a_recording_of_an_odd_estimate_is_replayed_and_converted(tmp_path):
    odd = (1, 1, 1) * 2 + (1, 1, 2**31 - 1) * (len(outputs.NAMES) - 2)
    place = (10, 0, 10, 0, 50_000)
    told = (wires.STREAM, 1, 0, 3 | 2 << 2, 0, 900, 400, b"MODEL-ID", *place)
    packet = wires.packet("estimate", told, odd)
    path = tmp_path / "odd.mcap"
    record(path, wires.identified() + wires.started() + wires.frame(0) + packet)
    (stroke,) = replay(path)
    assert estimate_lines(stroke.probe) and stroke.as_dict()
    assert convert(path, tmp_path / "odd.csv").estimates == 1


def test_depth_and_stiffness_of_what_cannot_be_stay_numbers():
    low = 1e-6
    value, least, most = spans.depth_mm((2147.0, low, 2147.0), (low, low, low), (low, low, low))
    assert 0 < least <= value <= most < math.inf


class Liar:
    """A transport to something that answers commands as `answers` says: name -> fields -> values, tail."""

    name = "liar"

    def __init__(self, **answers):
        self.answers = {"identify": lambda nonce: (nonce, *IDENTITY), **answers}
        self.heard = wire.Receiver(messages.COMMAND_BODY)
        self.out = bytearray()
        self.asked = 0

    def read(self, timeout_s):
        data = bytes(self.out)
        self.out.clear()
        if not data:
            time.sleep(min(timeout_s, 0.001))
        return data

    def write(self, data):
        at = 0
        while at < len(data):
            self.heard.length = 0
            at = self.heard.feed(data, at, len(data))
            if self.heard.length:
                self.asked += 1
                packet = self.heard.packet
                name = messages.TABLE[packet[0]][1]
                fields = messages.unpack(packet, self.heard.length)
                said = self.answers[name](*fields)
                values, tail = said if isinstance(said[0], tuple) else (said, b"")
                self.out += wires.packet(name, values, tail, messages.message_id(packet), answer=True)

    def close(self):
        pass


IDENTITY = (messages.PROTOCOL, messages.SCHEMA, b"\0\2\0", b"MADE--UP", 16, 26, 1500, 12, 1, 7, 0, bytes(8),
            1, 0, 0, 0)  # fmt: skip


@pytest.mark.parametrize(
    "lie",
    [
        lambda what, at: ((what, at + 7, 9000), b"wrongplace"),
        lambda what, at: ((what, 0, 9000), b"the same again"),
        lambda what, at: ((what, at, at + 9000), b"there is always more"),
        lambda what, at: ((what, at, 2**31), b"endless"),
    ],
)
def test_a_probe_that_reads_back_for_ever_is_left(lie):
    liar = Liar(read_back=lie)
    with Probe(liar) as probe, pytest.raises(Contradiction, match="liar"):
        probe.read_back(messages.READ_MODEL)
    assert liar.asked < 100


@pytest.mark.parametrize("kept", [lambda at: 0, lambda at: 48 if at == 0 else 0, lambda at: 2**31])
def test_a_probe_that_keeps_nothing_of_a_model_is_left(images, kept):
    """It answered that it had received nothing, and was sent the same piece for ever."""
    liar = Liar(flash_begin=lambda size, name: (0,), flash_data=lambda at, data: (kept(at),))
    with Probe(liar) as probe, pytest.raises(FlashError, match="does not keep what it is sent"):
        flash(probe, images[0])
    assert liar.asked < 300


def test_a_second_program_reads_that_the_probe_is_busy(emulated):
    """It took the line from the first, was cut off in turn, and said that the probe was unplugged."""
    device = emulated("cpython", listen="tcp:127.0.0.1:0")
    with Probe(open_transport(device.port)) as first:
        with pytest.raises(PortBusy, match="is busy: another program is connected"):
            Probe(open_transport(device.port))
        assert first.statistics() and first.counts.reconnects == 0
    with Probe(open_transport(device.port)) as next_one:
        assert next_one.statistics()

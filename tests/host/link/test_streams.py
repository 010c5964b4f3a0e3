"""Whose results they are: what this client began comes as it is; what another left is offered apart."""

import itertools
import json
import time

import pytest

from firmware_py import messages, status
from palpate.errors import CommandRefused
from palpate.link import line, stream_wish
from palpate.link.flash import flash
from palpate.link.session import both_counts, recorded
from palpate.stroke.replay import replay
from palpate.wire.events import Estimate, Features, Frame, Gap, StreamEnd, StrokeState, TactileMap
from tests.host.probes import FRAMES, connect
from tests.sim.probe.test_emulated import Host
from tests.waiting import PATIENCE_S, wait_until


def leave_a_stroke_behind(device):
    """A client that begins a stream of one stroke and goes away before its results have come."""
    with Host(device) as host:
        begun = host.ask("stream_start", (messages.CONTENT_STROKES, 1, 1, 0)).fields
        host.listen(lambda m: m.name == "stream_end")
        assert not [m for m in host.heard if m.name == "stroke_ack"]
    return begun["stream"]


@pytest.mark.parametrize("runtime", ["cpython", "micropython"])
def test_a_stroke_of_an_earlier_client_is_not_this_ones(emulated, images, tmp_path, runtime):
    """`palpate stream --strokes 1` printed the stroke before it, and its recording could not be replayed."""
    device = emulated(runtime, repeat=True)
    with connect(device) as probe:
        flash(probe, images[0])
    left = leave_a_stroke_behind(device)
    path = tmp_path / "mine.mcap"
    with recorded(device.port, path) as probe:
        events = list(probe.stream(strokes=1, timeout_s=PATIENCE_S))
        apart = probe.earlier_results()
    (mine,) = [e for e in events if isinstance(e, Estimate)]
    assert mine.stream != left
    frames = [e.seq for e in events if isinstance(e, Frame)]
    assert frames[0] <= mine.first_seq < mine.last_seq <= frames[-1]
    assert {e.stream for e in events if isinstance(e, StrokeState | TactileMap | Features)} == {mine.stream}
    assert {(type(e), e.stream) for e in apart} == {(k, left) for k in (TactileMap, Features, Estimate)}
    with connect(device) as probe:
        assert probe.earlier_results() == [], "they were acknowledged"
    (stroke,) = replay(path)
    assert stroke.identical


def test_the_command_line_shows_what_was_left_behind_apart(emulated, images, palpate):
    device = emulated(repeat=True)
    with connect(device) as probe:
        flash(probe, images[0])
    left = leave_a_stroke_behind(device)
    for expected in ([left], []):
        exit_status, out, _ = palpate("stream", "--port", device.port, "--strokes", 1, "--earlier", "--json")
        told = json.loads(out)
        assert exit_status == 0
        assert [e["stream"] for e in told["earlier"]] == expected
        assert len(told["strokes"]) == 1
        assert told["strokes"][0]["stream"] != left


def test_a_client_that_goes_away_does_not_leave_the_probe_streaming(emulated, monkeypatch):
    monkeypatch.setattr(stream_wish, "LEASE_MS", 500)
    device = emulated(repeat=True)
    with connect(device) as probe:
        probe.start_stream()
        next(e for e in probe.events(PATIENCE_S) if isinstance(e, Frame))
    with connect(device) as probe:
        assert probe.identity.stream
    time.sleep(1.0)  # any word would be one of its host's
    with connect(device) as probe:
        assert probe.identity.stream == 0
        assert probe.statistics()["leases_expired"] == 1


def test_a_client_that_reads_slowly_keeps_its_lease(emulated, monkeypatch):
    """Its thread says that it is there, whatever the program does."""
    monkeypatch.setattr(stream_wish, "LEASE_MS", 1000)
    monkeypatch.setattr(line, "RENEW_S", 0.2)
    with connect(emulated(repeat=True)) as probe:
        begun = probe.start_stream()
        time.sleep(2.5)
        assert probe.refresh_identity().stream == begun.number
        assert probe.statistics()["leases_expired"] == 0


def test_a_client_that_was_stopped_for_longer_than_its_lease_begins_anew_and_is_told(emulated, monkeypatch):
    monkeypatch.setattr(stream_wish, "LEASE_MS", 500)
    with connect(emulated(repeat=True)) as probe:
        begun = probe.start_stream()
        renew = line.RENEW_S
        monkeypatch.setattr(line, "RENEW_S", 1e9)
        events = probe.events(PATIENCE_S)
        end = next(e for e in events if isinstance(e, StreamEnd))
        assert (end.stream, end.reason) == (begun.number, "lease")
        monkeypatch.setattr(line, "RENEW_S", renew)
        later = next(e for e in events if isinstance(e, StrokeState) and e.stream != begun.number)
        assert later.stream == probe.refresh_identity().stream


def test_a_stream_goes_on_through_an_unplug_with_the_stroke_in_it(emulated, images):
    """It was begun anew, which broke the stroke off and counted the strokes from nothing."""
    device = emulated()
    with connect(device) as probe:
        flash(probe, images[0])
        begun = probe.start_stream(strokes=1)
        seen = []
        for event in probe.events(PATIENCE_S):
            seen.append(event)
            if isinstance(event, StrokeState) and event.state == "started":
                device.unplug()
            if isinstance(event, Estimate):
                break
        assert [e.ended for e in seen if isinstance(e, Gap)] == [False, True]
        assert (seen[-1].stream, seen[-1].stroke) == (begun.number, begun.next_stroke)
        assert seen[-1].frames >= FRAMES - 5, "a whole stroke"


def test_the_counts_are_this_sessions(emulated):
    """The probe counts since it was switched on: "3450 dropped" were another session's."""
    device = emulated(repeat=True)
    counts = []
    for strokes in (3, 1):
        with recorded(device.port, None) as probe:
            list(probe.stream(strokes=strokes, timeout_s=PATIENCE_S))
            counts.append(both_counts(probe))
    assert counts[1]["probe_estimates"] < counts[0]["probe_estimates"]
    assert counts[1]["probe_estimates"] == counts[1]["host_strokes_received"] + counts[1]["host_strokes_lost"]
    assert counts[1]["probe_frames_acquired"] < counts[0]["probe_frames_acquired"]


def test_an_estimate_whose_acknowledgement_came_too_late_is_received_once(emulated, monkeypatch):
    """A busy host took more strokes than the probe keeps before it acknowledged the first of them."""
    held, acknowledge = [], line.Line.acknowledge

    def late(self, result):
        held.append(result)
        while held and result.stroke > begun.next_stroke + 33:
            acknowledge(self, held.pop(0))

    monkeypatch.setattr(line.Line, "acknowledge", late)
    with connect(emulated(repeat=True)) as probe:
        begun = probe.start_stream(frames=False)
        seen = strokes_of(probe, 36)
        told, counts = both_ends(probe)
    assert len(set(seen)) == len(seen)
    assert told["estimates_given_up"] > 0
    assert counts.strokes_received + counts.strokes_lost == told["strokes"] == told["estimates"]
    assert told["estimates_acknowledged"] + told["estimates_given_up"] == told["estimates"]


def strokes_of(probe, many):
    """The strokes of so many estimates, from a probe that measures as fast as it can."""
    probe.set_setting("frame_rate", 400_000)
    estimates = (e.stroke for e in probe.events(PATIENCE_S) if isinstance(e, Estimate))
    return list(itertools.islice(estimates, many))


def both_ends(probe):
    """What the probe and the host have counted when the stream is over and every acknowledgement has come."""
    probe.stop_stream()
    wait_until(lambda: probe.statistics()["estimates_waiting"] == 0, "every acknowledgement")
    return probe.statistics(), probe.counts


def test_confirming_again_after_a_lost_answer_is_no_mistake(emulated, images):
    """A host that had lost the answer, and the link, was told -5 although its model was live."""
    with connect(emulated()) as probe:
        done = flash(probe, images[0])
        probe.refresh_identity()  # empties the memory of answers, as a reconnect does
        model_id = bytes.fromhex(done.model_id)
        assert bytes(probe.command("flash_confirm", model_id)[0]) == model_id
        with pytest.raises(CommandRefused) as refusal:
            probe.command("flash_confirm", b"another!")
        assert refusal.value.status == status.BAD_STATE


def test_a_refused_image_is_refused_again_with_the_same_reason(emulated, images):
    """After a lost answer the reason had become "not in the state for this message"."""
    changed = bytearray(images[0])
    changed[len(changed) // 2] ^= 4
    with connect(emulated()) as probe:
        codes = []
        probe.command("flash_begin", len(changed), b"the name")
        for at in range(0, len(changed), messages.FLASH_PIECE):
            probe.command("flash_data", at, tail=bytes(changed[at : at + messages.FLASH_PIECE]))
        for _ in range(2):
            with pytest.raises(CommandRefused) as refusal:
                probe.command("flash_verify", b"the name")
            codes.append(refusal.value.status)
            probe.refresh_identity()
        assert codes == [status.BAD_SIGNATURE] * 2

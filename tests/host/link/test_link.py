"""The client against the real firmware, over real pseudo-terminals and sockets."""

import os
import pty
import re
import threading
import tty
from itertools import pairwise

import pytest

from firmware_py import messages, wire
from palpate.errors import CommandRefused, CommandTimeout, LinkGone, NotAProbe, UsageError
from palpate.link import emulated as notes
from palpate.link.flash import flash
from palpate.link.probe import Probe
from palpate.link.transport import FdTransport, open_transport
from palpate.wire.events import Estimate, Features, Frame, Gap, StrokeState, TactileMap
from tests.host.probes import FRAMES, LUMP, connect, settled
from tests.waiting import PATIENCE_S, wait_until

RUNTIMES = [("cpython", "pty"), ("micropython", "pty"), ("micropython", "tcp:127.0.0.1:0")]


@pytest.mark.parametrize(("runtime", "listen"), RUNTIMES)
def test_a_probe_says_who_it_is_takes_a_model_and_answers_a_stroke(emulated, images, runtime, listen):
    with connect(emulated(runtime, listen=listen, serial=b"SERIAL-7")) as probe:
        assert probe.identity.serial == b"SERIAL-7".hex()
        assert not probe.identity.has_model
        done = flash(probe, images[0])
        assert probe.identity.has_model and probe.identity.model_id == done.model_id
        assert probe.read_back(messages.READ_MODEL) == images[0]
        events = list(probe.stream(strokes=2, timeout_s=PATIENCE_S))
        frames = [e for e in events if isinstance(e, Frame)]
        estimates = [e for e in events if isinstance(e, Estimate)]
        assert [e.stroke for e in estimates] == [1, 2]
        assert all(e.valid and e.model_id.hex() == done.model_id for e in estimates)
        assert [f.seq for f in frames] == list(range(frames[0].seq, frames[0].seq + len(frames)))
        assert len(frames) >= 2 * FRAMES
        for kind in (TactileMap, Features):
            assert [e.stroke for e in events if isinstance(e, kind)] == [1, 2]
        assert {"contact", "started", "lump_passed", "ended"} <= {
            e.state for e in events if isinstance(e, StrokeState)
        }


def test_frames_are_what_the_sensors_read(emulated, strokes):
    with connect(emulated()) as probe:
        frames = [e for e in probe.stream(timeout_s=PATIENCE_S, strokes=1) if isinstance(e, Frame)]
    touched = frames[3 : 3 + FRAMES]
    assert [f.packed for f in touched] == [bytes(p) for p in strokes[0].packed]
    assert [f.position_um for f in touched] == strokes[0].positions_um.tolist()
    assert [f.displacement_um for f in touched] == strokes[0].displacements_um.tolist()
    assert (touched[0].counts.ravel() == strokes[0].counts[0]).all()
    times = [f.time_us for f in frames]
    assert times == sorted(times)


def test_both_ends_count_the_same(emulated):
    with connect(emulated()) as probe:
        probe.set_setting("frame_rate", 500_000)
        list(probe.stream(strokes=2, timeout_s=PATIENCE_S))
        told = settled(probe)
        assert probe.frame_counts.received == told["frames_sent"]
        assert probe.frame_counts.lost == told["frames_dropped"]
        assert probe.counts.bad_crc == probe.counts.bad_frame == probe.counts.unreadable == 0


def test_settings_are_kept_and_guarded(emulated):
    with connect(emulated()) as probe:
        probe.set_setting("frame_rate", 123_000)
        assert probe.get_setting("frame_rate") == 123_000
        with pytest.raises(CommandRefused, match=r"frame_rate takes 100 to 10000000 mHz, not 1 "):
            probe.set_setting("frame_rate", 1)
        with pytest.raises(UsageError, match="frame_rate"):
            probe.get_setting("colour")


def test_each_nth_frame_is_no_loss(emulated):
    with connect(emulated()) as probe:
        events = probe.stream(strokes=1, every=3, timeout_s=PATIENCE_S)
        frames = [e for e in events if isinstance(e, Frame)]
        assert {b.seq - a.seq for a, b in pairwise(frames)} == {3}
        assert probe.frame_counts.lost == 0


def test_the_clock_is_compared(emulated):
    with connect(emulated()) as probe:
        wait_until(lambda: probe.sync_clock().uncertainty_us < 50_000, "one quick exchange")
        uncertainty_us, behind_us = probe.clock.uncertainty_us, []
        for event in probe.stream(timeout_s=PATIENCE_S):
            if isinstance(event, Frame):
                behind_us.append(event.host_ns / 1000 - probe.host_time_us(event.time_us))
                if min(behind_us) < 100_000 and len(behind_us) > FRAMES:
                    break
        assert min(behind_us) > -uncertainty_us - 1000, "no frame comes before it was taken"


class Tardy(FdTransport):
    """Holds back what comes until the host has asked `asks` times."""

    def __init__(self, inner, asks):
        self.inner, self.asks, self.name = inner, asks, inner.name
        self.held = b""

    def read(self, timeout_s):
        self.held += self.inner.read(timeout_s)
        if self.asks > 0:
            return b""
        held, self.held = self.held, b""
        return held

    def write(self, data):
        self.asks -= 1
        self.inner.write(data)

    def close(self):
        self.inner.close()


def test_a_late_answer_is_dropped_and_shifts_nothing(emulated):
    transport = Tardy(open_transport(emulated().port), 0)
    with Probe(transport) as probe:
        transport.asks, late = 2, probe.counts.late_answers
        with pytest.raises(CommandTimeout):
            probe.command("get_setting", 0, timeout_s=0.2, once=True)
        assert probe.get_setting("contact_threshold") == 300  # not the frame rate that was asked before
        assert probe.counts.late_answers > late


def test_a_command_sent_twice_is_executed_once(emulated):
    transport = Tardy(open_transport(emulated().port), 0)
    with Probe(transport) as probe:
        before, retries = probe.statistics(), probe.counts.retries
        transport.asks = 3
        probe.set_setting("frame_rate", 77_000)
        after = probe.statistics()
        assert probe.counts.retries - retries >= 2
        assert after["commands_duplicate"] - before["commands_duplicate"] >= 2
        assert after["commands"] - before["commands"] == 2  # the setting, and the statistics before it


def test_an_unplugged_probe_comes_back_and_the_gap_is_marked(emulated):
    device = emulated()
    with connect(device) as probe:
        probe.set_setting("frame_rate", 200_000)
        probe.start_stream()
        seen, frames = [], 0
        for event in probe.events(PATIENCE_S):
            seen.append(event)
            frames += isinstance(event, Frame)
            if frames == 10:
                device.unplug()
                frames += 1
            gaps = [e for e in seen if isinstance(e, Gap)]
            # the estimate is sent again until it is acknowledged: it may come before the stream is back
            if any(isinstance(e, Estimate) for e in seen) and gaps and gaps[-1].ended:
                break
        assert [g.ended for g in gaps] == [False, True]
        assert not gaps[1].restarted and "gone" in gaps[0].reason
        assert probe.counts.reconnects == 1
        probe.stop_stream()
        settled(probe)


def test_where_any_probe_will_do_a_stream_goes_on_with_another(emulated):
    """A replaced board, or an emulator that was started again, was waited for in vain."""
    first = emulated(repeat=True, serial=b"FIRST001")
    note = notes.leave(notes.Note(first.port, os.getpid(), LUMP, "cpython"))
    with Probe.open("auto") as probe:
        mine = probe.identity.serial
        probe.start_stream()
        assert any(isinstance(event, Frame) for event in probe.events(PATIENCE_S))
        note.unlink()
        first.stop()
        second = emulated(repeat=True, serial=b"SECOND02")
        notes.leave(notes.Note(second.port, os.getpid(), LUMP, "cpython"))
        gaps = []
        for event in probe.events(PATIENCE_S):
            gaps += [event] if isinstance(event, Gap) else []
            if len(gaps) == 2 and isinstance(event, Frame):
                break
        assert gaps[1].ended and gaps[1].restarted
        assert probe.identity.serial != mine
        probe.stop_stream()


def test_a_restarted_probe_is_noticed(emulated):
    device = emulated(listen="tcp:127.0.0.1:0")
    with connect(device) as probe:
        boots = probe.identity.boots
        probe.start_stream()
        next(e for e in probe.events(PATIENCE_S) if isinstance(e, Frame))
        device.cut_power()
        device.start()
        device.unplug()
        gap = next(e for e in probe.events(PATIENCE_S) if isinstance(e, Gap) and e.ended)
        assert gap.restarted
        assert probe.identity.boots == boots + 1
        assert next(e for e in probe.events(PATIENCE_S) if isinstance(e, Frame)).seq < FRAMES
        assert probe.frame_counts.restarts == 1


def test_without_a_way_back_a_lost_link_is_an_error(emulated):
    device = emulated()
    with Probe(open_transport(device.port)) as probe:
        probe.start_stream()
        device.unplug()
        with pytest.raises(LinkGone, match="plug it in again"):
            list(probe.events(PATIENCE_S))


def test_something_else_at_the_other_end_is_no_probe():
    _ours, theirs = pty.openpty()
    tty.setraw(theirs)
    with pytest.raises(NotAProbe, match="does not answer as a Palpate probe"):
        Probe(open_transport(os.ttyname(theirs)))


def test_why_a_probes_firmware_does_not_start_is_told():
    """The board was silent, and the host said only that something was no probe."""
    why = "the probe does not start: ImportError: no module named 'wire'"
    body, packet = bytearray(128), bytearray(256)
    n = messages.pack(body, messages.TYPE["log"], 0, 0, (messages.LOG_ERROR, 1), why.encode())
    end = wire.seal(body, n, packet, 1)
    ours, theirs = pty.openpty()
    tty.setraw(theirs)

    def answer():
        os.read(ours, 64)  # the handshake
        os.write(ours, packet[:end])

    speaker = threading.Thread(target=answer)
    speaker.start()
    with pytest.raises(NotAProbe, match=re.escape(f"it says: {why}")):
        Probe(open_transport(os.ttyname(theirs)))
    speaker.join()


@pytest.mark.parametrize("step_s", [600, -600, 80 * 365 * 86400])
def test_a_step_of_the_hosts_clock_moves_no_device_time(emulated, monkeypatch, step_s):
    """From nine minutes on the probe's times were shifted by turns of 17.9 minutes, in silence."""
    import time

    with connect(emulated()) as probe:
        probe.start_stream()
        frames = (e for e in probe.events(PATIENCE_S) if isinstance(e, Frame))
        before = [next(frames) for _ in range(3)][-1]
        now = time.time_ns
        monkeypatch.setattr(time, "time_ns", lambda: now() + step_s * 1_000_000_000)
        later = [next(frames) for _ in range(5)][-1]
        assert 0 < later.time_us - before.time_us < 60_000_000
        assert 0 < later.host_ns - before.host_ns < 60_000_000_000


@pytest.mark.parametrize("value", [10**20, -(10**20), 1 << 31])
def test_a_setting_that_the_wire_cannot_carry_is_refused_with_its_limits(emulated, value):
    with connect(emulated()) as probe:
        with pytest.raises(CommandRefused, match=r"frame_rate takes \d+ to \d+ mHz"):
            probe.set_setting("frame_rate", value)
        with pytest.raises(UsageError, match="none to calibrate with"):
            probe.calibrate_gain(1e308)

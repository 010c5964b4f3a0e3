"""Recordings: whole to the last complete frame whatever happens, and the same session when played."""

import resource
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from palpate.errors import DiskFull, NoSuchFile, NotARecording, NotLive, RecordingError, UnknownFormat
from palpate.link.probe import Probe
from palpate.link.reader import LineReader
from palpate.recording import channels
from palpate.recording.convert import convert
from palpate.recording.playback import open_recording
from palpate.recording.reader import Recording
from palpate.recording.writer import RecordingWriter
from palpate.wire.events import Estimate, Frame, Gap, Log
from palpate.wire.parser import LiveParser
from tests.host.link import wires
from tests.host.probes import connect, settled
from tests.host.recording.recorded import record
from tests.waiting import PATIENCE_S

WRITER = """
import sys, time
from palpate.wire.parser import LiveParser
from palpate.recording.writer import RecordingWriter
from tests.host.link import wires
writer, parser = RecordingWriter(sys.argv[1]), LiveParser()
def put(data):
    for event in parser.feed(data, time.time_ns()):
        writer.received(parser.raw, event, time.time_ns())
put(wires.identified())
for k in range(int(sys.argv[2])):
    put(wires.frame(k))
    writer.check()
    print(k, flush=True)
writer.close()
"""


def frames_of(path) -> list[int]:
    with open_recording(path) as probe:
        return [e.seq for e in probe.events() if isinstance(e, Frame)]


@pytest.mark.parametrize("after", [1, 40, 200])
def test_kill_9_leaves_every_frame_that_was_taken(tmp_path, after):
    path = tmp_path / "killed.mcap"
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, path, "100000"], stdout=subprocess.PIPE, text=True
    ) as writer:
        told = [int(writer.stdout.readline()) for _ in range(after)]
        writer.send_signal(signal.SIGKILL)
        told += [int(line) for line in writer.stdout.read().splitlines()]
    recording = Recording(path)
    assert not recording.finished
    seen = frames_of(path)
    assert seen == list(range(len(seen)))
    assert len(seen) >= told[-1] + 1


def test_a_file_cut_at_any_byte_opens_to_its_last_complete_frame(tmp_path):
    whole = tmp_path / "whole.mcap"
    record(whole, wires.identified() + b"".join(wires.frame(k) for k in range(3)), seal=False)
    data = whole.read_bytes()
    head = data.index(b"palpate recording") + 200
    cut, before = tmp_path / "cut.mcap", 0
    for at in [*range(head, len(data), 19), len(data)]:
        cut.write_bytes(data[:at])
        raw = b"".join(piece for _, _, piece in Recording(cut).wire())
        parser = LiveParser()
        seen = [e.seq for e in parser.feed(raw, 0) if isinstance(e, Frame)]
        assert seen == list(range(len(seen))) and len(seen) >= before
        before = len(seen)
    assert before == 3


def test_a_full_disk_is_said_and_costs_nothing_that_was_written(tmp_path):
    path = tmp_path / "full.mcap"
    run = subprocess.run(
        [sys.executable, "-c", WRITER, path, "100000"], capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)),
    )  # fmt: skip
    assert f"{DiskFull.__name__}: the disk is full" in run.stderr
    told = [int(line) for line in run.stdout.split()]
    assert frames_of(path) == told
    assert len(told) > 10


def test_a_recording_holds_the_wire_byte_for_byte_damage_included(tmp_path):
    damaged = bytearray(wires.frame(1))
    damaged[100] ^= 1
    data = wires.identified() + wires.frame(0) + bytes(damaged) + wires.frame(2) + b"\x07half"
    path = tmp_path / "damage.mcap"
    record(path, data)
    assert b"".join(raw for _, _, raw in Recording(path).wire()) == data
    with open_recording(path) as probe:
        frames = [e for e in probe.events() if isinstance(e, Frame)]
        assert [f.seq for f in frames] == [0, 2]
        assert frames[1].lost_before == 1
        assert probe.counts.bad_crc == 1 and probe.frame_counts.lost == 1


def test_noise_reaches_the_disk_as_it_comes(tmp_path):
    """Nothing was written while no packet came; a kill then lost all of it."""
    noise = np.random.default_rng(5).integers(1, 256, 300_000, dtype=np.uint8).tobytes()
    parser, path = LiveParser(), tmp_path / "noise.mcap"
    writer = RecordingWriter(path)
    for at in range(0, len(noise), 1000):
        for event in parser.feed(noise[at : at + 1000], 1):
            writer.received(parser.raw, event, 1)
        kept = b"".join(raw for _, _, raw in Recording(path).wire()) if at % 100_000 == 0 else None
        assert kept is None or (noise.startswith(kept) and len(kept) > at - 5000)
    writer.received(parser.take_tail(), None, 1)
    writer.close()
    assert b"".join(raw for _, _, raw in Recording(path).wire()) == noise


def test_a_quiet_line_leaves_nothing_in_memory(tmp_path):
    """Half a packet, then silence: it is on disk before anything else comes."""
    path, ours = tmp_path / "quiet.mcap", [b"\x07half"]

    class Wire:
        name = "made up"

        def read(self, timeout_s):
            return ours.pop() if ours else time.sleep(0.01) or b""

        def close(self):
            pass

    reader = LineReader(Wire(), RecordingWriter(path))
    deadline = time.monotonic() + PATIENCE_S
    while not list(Recording(path).wire()) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert [raw for _, _, raw in Recording(path).wire()] == [b"\x07half"]
    reader.close()
    reader.recorder.close()


@pytest.mark.parametrize("before", [b"", 400 * b"\xa5chatter of another program\n"])
def test_a_recording_without_a_handshake_is_read(tmp_path, before):
    """It was refused whole where the handshake was cut off, or came late."""
    path = tmp_path / "without.mcap"
    data = before + b"\0" + b"".join(wires.frame(k) for k in range(9))
    record(path, data)
    with open_recording(path) as played:
        assert not played.identified and played.identity.serial == ""
        assert [e.seq for e in played.events() if isinstance(e, Frame)] == list(range(9))
    late = tmp_path / "late.mcap"
    record(late, data + wires.identified() + wires.frame(9))
    with open_recording(late) as played:
        assert played.identified
        assert [e.seq for e in played.events() if isinstance(e, Frame)] == list(range(10))
    early = tmp_path / "early.mcap"
    writer = RecordingWriter(early)
    writer.close(seal=False)
    with open_recording(early) as played:
        assert list(played.events()) == []


def test_a_session_played_is_the_session_that_was_live(emulated, tmp_path):
    path = tmp_path / "session.mcap"
    device = emulated("micropython")
    with RecordingWriter(path) as writer, connect(device, writer) as probe:
        probe.set_setting("frame_rate", 150_000)
        live, unplugged = [], False
        for event in probe.stream(strokes=1, timeout_s=PATIENCE_S):
            live.append(event)
            if not unplugged and sum(isinstance(e, Frame) for e in live) == 12:
                device.unplug()
                unplugged = True
        settled(probe)
        counts = probe.frame_counts
        identity = probe.identity
    with open_recording(path) as played:
        assert played.identity.serial == identity.serial and not played.live
        events = list(played.events())
        assert played.frame_counts == counts
        assert list(played.events()) == events, "it plays again from the beginning"
    told = [e for e in live if isinstance(e, Frame | Estimate | Gap)]
    again = [e for e in events if isinstance(e, Frame | Estimate | Gap)]
    assert again[: len(told)] == told
    gaps = [e for e in events if isinstance(e, Gap)]
    assert [g.ended for g in gaps] == [False, True]
    with pytest.raises(NotLive, match="is a recording, not a port"):
        Probe.open(str(path))


def test_what_is_no_recording_and_what_cannot_be_written(tmp_path):
    (tmp_path / "text.mcap").write_text("not MCAP at all")
    (tmp_path / "empty.mcap").touch()
    for name in ("text.mcap", "empty.mcap"):
        with pytest.raises(NotARecording, match="no MCAP"):
            Recording(tmp_path / name)
    with pytest.raises(NoSuchFile, match="check the name"):
        Recording(tmp_path / "none.mcap")
    good = tmp_path / "good.mcap"
    record(good, wires.identified())
    with pytest.raises(RecordingError, match="--overwrite"):
        RecordingWriter(good)
    with pytest.raises(RecordingError, match="choose another place"):
        RecordingWriter(tmp_path / "text.mcap" / "place.mcap")
    with pytest.raises(UnknownFormat, match=r"\.parquet"):
        convert(good, tmp_path / "out.xlsx")
    assert not list(tmp_path.glob(".*")), "a temporary file was left"


def test_of_recordings_that_take_one_new_name_at_once_one_has_it_and_the_others_are_told(tmp_path):
    hosts, told = 8, []
    for k in range(10):
        path, start, opened = tmp_path / f"{k}.mcap", threading.Barrier(hosts), []

        def begin(host, path=path, start=start, opened=opened):
            start.wait()
            try:
                opened.append((host, RecordingWriter(path, metadata={"host": str(host)})))
            except RecordingError as error:
                told.append(str(error))

        threads = [threading.Thread(target=begin, args=(host,)) for host in range(hosts)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        [(host, writer)] = opened
        writer.close()
        assert Recording(path).metadata()["session"]["host"] == str(host)
    assert len(told) == 10 * (hosts - 1) and all("exists already; choose another name" in t for t in told)
    assert not list(tmp_path.glob(".*")), "a temporary file was left"


@pytest.mark.parametrize("end", ["close", "discard"])
def test_a_recording_that_another_wrote_over_leaves_the_other_alone(tmp_path, end):
    path = tmp_path / "shared.mcap"
    first, second = RecordingWriter(path), RecordingWriter(path, overwrite=True)
    getattr(first, end)()
    parser = LiveParser()
    for event in parser.feed(wires.identified() + wires.frame(0) + wires.frame(1), 0):
        second.received(parser.raw, event, 0)
    second.close()
    assert frames_of(path) == [0, 1]


def test_an_event_of_ones_own_is_recorded_beside_the_session(tmp_path, emulated):
    """A video or a remark goes the same way: there was no door to the recorder of an open probe."""
    path = tmp_path / "session.mcap"
    with RecordingWriter(path) as writer, connect(emulated("cpython"), writer) as probe:
        probe.mark(Log(time.time_ns(), 0, 0, "breath held"))
    logged = [record.data for topic, record in Recording(path).records() if topic == channels.LOG]
    assert any(channels.read_json(data)["message"] == "breath held" for data in logged)
    with connect(emulated("cpython")) as probe:
        probe.mark(Log(time.time_ns(), 0, 0, "nobody records"))


def test_a_device_time_just_below_the_first_one_ends_no_recording(tmp_path):
    """At the wrap of the probe's clock a late packet has a time below zero: its publish time did not fit."""
    path = tmp_path / "wrap.mcap"
    times = [10, (1 << 30) - 5000, 5000, 1 << 28]
    record(path, wires.identified() + b"".join(wires.frame(k, t) for k, t in enumerate(times)))
    with open_recording(path) as played:
        told = [e.time_us for e in played.events() if isinstance(e, Frame)]
    assert told == [10, -5000, 5000, 1 << 28]
    assert not Recording(path).check()

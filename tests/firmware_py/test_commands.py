"""The probe towards its host, friendly or hostile.

Every command answered once, nothing executed that should not be.
"""

import struct

import numpy as np
import pytest

from firmware_py import geometry, messages, status
from palpate.sim.probe import source
from palpate.sim.probe.virtual import VirtualBoard
from palpate.wire.identity import Identity
from tests.campaigns import counted
from tests.firmware_py.talk import Bench, Ears, command

FRAMES = messages.CONTENT_FRAMES


def test_identify_says_who_it_is_and_gives_the_nonce_back():
    fields = Bench().ask("identify", (12345,)).fields
    assert fields["nonce"] == 12345
    assert (fields["protocol"], fields["schema"]) == (messages.PROTOCOL, messages.SCHEMA)
    assert fields["serial"] == b"VIRTUAL0"
    assert (fields["rows"], fields["columns"], fields["pitch_um"], fields["bits"]) == (16, 26, 1500, 12)
    assert fields["model_status"] == status.NO_MODEL


def test_identify_says_what_the_probe_can_do(tmp_path):
    bench = Bench.measuring(tmp_path)
    told = Identity.from_answer(tuple(bench.ask("identify", (1,)).fields.values()))
    assert told.capabilities == ("calibrate",)


def test_a_probe_tells_that_it_has_started():
    assert [m.name for m in Bench().run(1000)] == ["boot"]


def test_a_repeated_command_is_executed_once_and_answered_each_time():
    bench = Bench()
    bench.run(1000)
    again = command("set_setting", 7, (0, 40000))
    first, second, third = (bench.send(again) for _ in range(3))
    assert len(first) == len(second) == len(third) == 1
    assert first[0] == second[0] == third[0]
    assert bench.probe.counter("commands") == 1
    assert bench.probe.counter("commands_duplicate") == 2


def test_an_id_that_comes_round_again_with_another_command_is_executed():
    bench = Bench()
    bench.run(1000)
    bench.send(command("set_setting", 7, (0, 40000)))
    assert bench.send(command("get_setting", 7, (0,)))[0].fields["value"] == 40000


def test_a_new_host_is_not_given_an_old_hosts_answers():
    bench = Bench()
    bench.run(1000)
    bench.send(command("stream_start", 1, (FRAMES, 1, 0, 0)))
    bench.send(command("identify", 2, (1,)))
    bench.send(command("stream_stop", 3))
    answers = [
        m for m in bench.send(command("stream_start", 1, (FRAMES, 1, 0, 0))) if m.name == "stream_start"
    ]
    assert len(answers) == 1
    assert bench.probe.board.streaming, "the second host's start was taken for a repetition"


def test_settings_keep_to_their_limits_and_survive_a_restart():
    bench = Bench()
    for key, _, _, lowest, highest, default in messages.SETTINGS:
        told = bench.ask("get_setting", (key,)).fields
        low, high = told["low"], told["high"]
        assert told["value"] == default
        assert (low, high) == (lowest, highest) or key in {k for pair in messages.ORDERED for k in pair}
        assert bench.ask("set_setting", (key, low)).code == status.OK
        assert bench.ask("set_setting", (key, low - 1)).code == status.BAD_VALUE
        assert bench.ask("set_setting", (key, high + 1)).code == status.BAD_VALUE
        assert bench.ask("get_setting", (key,)).fields["value"] == low
    assert bench.ask("get_setting", (200,)).code == status.BAD_VALUE
    restarted = Bench(board=VirtualBoard())
    restarted.probe.board.settings_record.store.files |= bench.probe.board.settings_record.store.files
    restarted = Bench(board=restarted.probe.board)
    for key in range(len(messages.SETTINGS)):
        told = restarted.ask("get_setting", (key,)).fields
        assert told["value"] == bench.ask("get_setting", (key,)).fields["value"] == told["low"]


def test_the_force_warnings_keep_their_order():
    """force_low over force_high was accepted: every frame was both too light and too strong."""
    low, high = messages.ORDERED[0]
    bench = Bench()
    assert bench.ask("set_setting", (low, 150_000)).code == status.BAD_VALUE
    assert bench.ask("get_setting", (low,)).fields["high"] == 149_999
    assert bench.ask("set_setting", (high, 15_000)).code == status.BAD_VALUE
    assert bench.ask("set_setting", (high, 400_000)).code == status.OK
    assert bench.ask("set_setting", (low, 300_000)).code == status.OK
    again = Bench(board=bench.probe.board)
    assert again.ask("get_setting", (low,)).fields["value"] == 300_000  # above the other's default
    board = VirtualBoard()
    board.settings_record.save(
        b"".join(struct.pack("<Bi", key, value) for key, value in ((low, 900_000), (high, 5_000)))
    )
    kept = [Bench(board).ask("get_setting", (key,)).fields["value"] for key in (low, high)]
    assert kept == [messages.SETTINGS[low][5], messages.SETTINGS[high][5]]


def test_a_setting_that_cannot_be_stored_is_not_changed():
    board = VirtualBoard()
    board.settings_record.store.create = lambda name, data=b"": status.STORE_ERROR
    bench = Bench(board)
    assert bench.ask("set_setting", (0, 40000)).code == status.STORE_ERROR
    assert bench.ask("get_setting", (0,)).fields["value"] == 50000


def test_frames_come_at_the_rate_that_was_set():
    bench = Bench()
    bench.ask("set_setting", (0, 100_000))
    start = bench.ask("stream_start", (FRAMES, 1, 0, 0))
    bench.run(1_000_000)
    frames = [m for m in bench.heard if m.name == "frame"]
    assert 100 <= len(frames) <= 102
    assert [f.fields["seq"] for f in frames] == list(range(start.fields["next_seq"], len(frames)))
    steps = np.diff([f.fields["time_us"] for f in frames])
    assert abs(steps.mean() - 10_000) < 50


def test_the_stop_says_which_frame_would_have_been_next():
    bench = Bench()
    bench.ask("stream_start", (FRAMES, 1, 0, 0))
    bench.run(200_000)
    last = [m for m in bench.heard if m.name == "frame"][-1]
    assert bench.ask("stream_stop").fields["next_seq"] == last.fields["seq"] + 1
    assert not [m for m in bench.run(200_000) if m.name == "frame"]


def test_every_nth_frame_keeps_the_numbers_of_all():
    bench = Bench()
    bench.ask("stream_start", (FRAMES, 3, 0, 0))
    bench.run(500_000)
    numbers = [m.fields["seq"] for m in bench.heard if m.name == "frame"]
    assert len(numbers) > 5
    assert set(np.diff(numbers)) == {3}


def test_time_sync_gives_the_probes_time():
    bench = Bench()
    fields = bench.ask("time_sync").fields
    assert 0 <= fields["received_us"] <= fields["sent_us"] <= bench.probe.board.now_us


def test_wrapping_numbers_wrap_without_a_jump():
    """Every counter, the frame numbers and the clock cross 2**30 in one stream."""
    board = VirtualBoard(start_us=messages.WRAP - 2_000_000)
    bench = Bench(board)
    bench.probe.firmware.acquire.seq = messages.WRAP - 50
    for i in range(len(bench.probe.firmware.counts)):
        bench.probe.firmware.counts[i] = messages.WRAP - 60
    bench.ask("stream_start", (FRAMES, 1, 0, 0))
    bench.run(4_000_000)
    bench.ask("stream_stop")
    frames = [m.fields for m in bench.heard if m.name == "frame"]
    assert len(frames) > 190
    for name, step in (("seq", 1), ("time_us", 20_000)):
        values = np.array([f[name] for f in frames])
        assert values.min() < values[0] <= values.max() < messages.WRAP
        steps = np.diff(values) % messages.WRAP
        assert abs(steps - step).max() <= (0 if name == "seq" else 1500)
    assert bench.probe.counter("frames_sent") == len(frames) - 60
    assert all(0 <= c < messages.WRAP for c in bench.probe.firmware.counts)


def test_frames_hold_what_the_sensors_read():
    random = np.random.default_rng(1)
    raw = bytearray()
    wanted = []
    for k in range(20):
        packed = random.integers(0, 256, geometry.FRAME_BYTES, dtype=np.uint8).tobytes()
        wanted.append((k * 1000 - 9000, -k, packed))
        raw += (
            (k * 1000 - 9000).to_bytes(4, "little", signed=True)
            + (-k).to_bytes(4, "little", signed=True)
            + packed
        )
    assert len(raw) == 20 * source.RECORD_BYTES
    bench = Bench(VirtualBoard(bytes(raw)))
    bench.ask("stream_start", (FRAMES, 1, 0, 0))
    bench.run(400_000)
    frames = [m.fields for m in bench.heard if m.name == "frame"][:20]
    assert [(f["position_um"], f["displacement_um"], f["tail"]) for f in frames] == wanted


@pytest.mark.long
def test_a_day_of_simulated_time():
    """24 h at ten frames a second, numbers started just below their wrap; the device clock wraps 80 times."""
    board = VirtualBoard(start_us=messages.WRAP - 1_000_000)
    bench = Bench(board)
    firmware = bench.probe.firmware
    firmware.acquire.seq = messages.WRAP - 1000
    for i in range(len(firmware.counts)):
        firmware.counts[i] = messages.WRAP - 1000
    bench.ask("set_setting", (0, 10_000))
    bench.ask("stream_start", (FRAMES, 1, 0, messages.LEASE_MOST_MS))
    ears = Ears()
    seen, before, wraps = 0, None, 0
    start = board.now_us
    while board.now_us - start < 24 * 3600 * 1_000_000:
        bench.probe.run(60_000_000)
        bench.probe.send(command("time_sync", 7))
        for m in ears.hear(bench.probe.take()):
            if m.name != "frame":
                continue
            now = (m.fields["seq"], m.fields["time_us"])
            if before:
                assert (now[0] - before[0]) % messages.WRAP == 1
                assert abs((now[1] - before[1]) % messages.WRAP - 100_000) < 60_000
                wraps += now[1] < before[1]
            before, seen = now, seen + 1
    counted(f"{seen} frames, {wraps} turns of the device clock")
    assert 863_990 <= seen <= 864_010
    assert wraps >= 80

"""The firmware in real MicroPython behind a real terminal: what only the real thing can show."""

import contextlib
import os
import select
import time

import numpy as np
import pytest

from firmware_py import calib, counters, geometry, messages, status
from palpate.sim.probe.emulated import EmulatedProbe
from palpate.sim.probe.endpoints import endpoint
from tests.benchmarks.bench_link import Still
from tests.firmware_py.talk import Ears, Message, command

PATIENCE_S = 120.0
"""For what must come in the end, on a machine of any speed."""
FRAMES, STROKES = messages.CONTENT_FRAMES, messages.CONTENT_STROKES


class Host:
    """A bare terminal with a parser."""

    def __init__(self, probe: EmulatedProbe) -> None:
        self._fd = os.open(probe.port, os.O_RDWR | os.O_NOCTTY)
        self.ears = Ears()
        self.heard: list[Message] = []
        self._number = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        os.close(self._fd)

    def write(self, data: bytes) -> None:
        while data:
            try:
                data = data[os.write(self._fd, data) :]
            except BlockingIOError:
                time.sleep(0.01)

    def listen(self, until, timeout_s: float = PATIENCE_S) -> Message:
        """Hear messages until one fulfils the condition."""
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            if not select.select([self._fd], [], [], 0.05)[0]:
                continue
            news = self.ears.hear(os.read(self._fd, 4096))
            self.heard += news
            for message in news:
                if until(message):
                    return message
        raise AssertionError(f"not heard; last {[m.name for m in self.heard[-5:]]}")

    def ask(self, name: str, values=()) -> Message:
        """A command and its answer, asked again each second like any host would."""
        self._number += 1
        number = self._number
        for _ in range(int(PATIENCE_S)):
            self.write(command(name, number, values))
            try:
                return self.listen(lambda m: m.number == number and m.kind & messages.ANSWER, 1.0)
            except AssertionError:
                continue
        raise AssertionError(f"no answer to {name}")

    def pass_time(self, us: int) -> None:
        """Wait until the probe's own clock has gone on."""
        began = self.ask("time_sync").fields["received_us"]
        while counters.elapsed(self.ask("time_sync").fields["received_us"], began) < us:
            time.sleep(0.01)

    def listen_until_it_ends(self, probe: EmulatedProbe, number: int) -> None:
        """Until a command is answered or the probe has no power any more."""
        end = time.monotonic() + PATIENCE_S
        while probe.running and time.monotonic() < end:
            with contextlib.suppress(AssertionError):
                self.listen(lambda m: m.number == number and m.kind & messages.ANSWER, 0.1)
                return


@pytest.fixture(params=["micropython", "cpython"])
def runtime(request):
    return request.param


def test_a_stroke_gives_its_map_and_features_and_they_are_sent_until_acknowledged(runtime):
    with EmulatedProbe(runtime, [Still()]) as probe, Host(probe) as host:
        host.ask("set_setting", (7, 200))
        host.ask("stream_start", (FRAMES | STROKES, 1, 1, 0))
        first = host.listen(lambda m: m.name == "estimate")
        again = host.listen(lambda m: m.name == "estimate")
        assert first.fields == again.fields
        assert first.fields["status"] == status.NO_MODEL
        assert first.fields["frames"] >= 55
        host.ask("stroke_ack", (first.fields["stream"], first.fields["stroke"], messages.HAVE_ALL))
        heard = len([m for m in host.heard if m.name == "estimate"])
        for _ in range(2):  # half a second of its time; and all that it had to say then
            host.pass_time(500_000)
        assert len([m for m in host.heard if m.name == "estimate"]) == heard
        states = [m.fields["state"] for m in host.heard if m.name == "stroke_state"]
        assert states[:2] == [messages.STATE_CONTACT, messages.STATE_STARTED]
        assert messages.STATE_ENDED in states
        numbers = [m.fields["event_seq"] for m in host.heard if m.name == "stroke_state"]
        assert numbers == list(range(1, len(numbers) + 1))
        assert not probe.complaints


def test_bytes_of_the_prompt_and_other_attacks_are_only_bytes(runtime):
    with EmulatedProbe(runtime, [Still()], repeat=True) as probe, Host(probe) as host:
        host.ask("stream_start", (FRAMES, 1, 0, 0))
        for attack in (b"\x03" * 200, b"\x04" * 200, b"\x01import os\x04\x03\x04", os.urandom(5000)):
            host.write(attack + b"\0")
            before = host.listen(lambda m: m.name == "frame").fields["seq"]
            after = host.listen(lambda m, b=before: m.name == "frame" and m.fields["seq"] > b + 3)
            assert after
        assert host.ask("identify", (7,)).fields["nonce"] == 7
        assert probe.running
        assert not probe.complaints


def test_settings_survive_power_cuts_in_the_middle_of_being_stored(runtime):
    """Cut after every few bytes of the record: the next start has the old or the new value, never none."""
    with EmulatedProbe(runtime) as probe:
        with Host(probe) as host:
            assert host.ask("set_setting", (0, 41_000)).code == status.OK
        value, seen = 41_000, set()
        for cut in (1, 9, 30, 51, 52, 60):
            new = value + 1
            probe.cut_power_after(cut)
            with Host(probe) as host:
                host.write(command("set_setting", 900 + cut, (0, new)))
                host.listen_until_it_ends(probe, 900 + cut)
            probe.cut_power()
            probe.start()
            with Host(probe) as host:
                kept = host.ask("get_setting", (0,)).fields["value"]
            assert kept in (value, new)
            seen.add(kept == new)
            value = kept
        assert seen == {False, True}
        with Host(probe) as host:
            assert host.ask("identify", (1,)).fields["boots"] == 7


@pytest.mark.parametrize("left", [b"", b"\xff\x00"])
def test_a_count_of_starts_that_a_power_cut_left_in_pieces_begins_again(tmp_path, left):
    (tmp_path / "boots").write_bytes(left)
    with EmulatedProbe("cpython", store=tmp_path) as probe, Host(probe) as host:
        assert host.ask("identify", (1,)).fields["boots"] == 1


def test_a_calibration_from_the_bench_is_the_probes_own():
    mine = calib.Calibration()
    mine.set_dead((5, 77, 300))
    with EmulatedProbe("micropython", calibration=mine) as probe, Host(probe) as host:
        blob = b""
        while True:
            piece = host.ask("read_back", (messages.READ_CALIBRATION, len(blob))).fields
            blob += piece["tail"]
            if len(blob) >= piece["size"]:
                break
        assert blob == mine.to_bytes()


def test_zeroing_takes_the_mean_of_the_frames_and_is_kept(runtime):
    offset = np.full(geometry.CELLS, 100)
    offset[7] = 0
    still = Still(40)
    frame = offset[0::2] | offset[1::2] << 12
    still.packed = [b"".join(int(p).to_bytes(3, "little") for p in frame)] * 40
    with EmulatedProbe(runtime, [still]) as probe:
        with Host(probe) as host:
            answer = host.ask("calibrate", (messages.CALIBRATE_ZERO, 30, 0))
            assert answer.code == status.OK
            assert answer.fields["frames"] == 30
        probe.cut_power()
        probe.start()
        with Host(probe) as host:
            blob = b"".join(host.ask("read_back", (0, at)).fields["tail"] for at in range(0, 1724, 200))
        kept = calib.Calibration()
        assert kept.load(blob) == status.OK
        expected = (3 * 82 + 27 * 100) / 30
        assert kept.offset[100] / 8 == pytest.approx(expected, abs=0.2)


def test_words_that_name_no_endpoint_or_runtime_are_refused():
    for words in ("tcp", "tcp:localhost", "tcp:localhost:99999", "usb"):
        with pytest.raises(ValueError, match="cannot listen on"):
            endpoint(words)
    with pytest.raises(ValueError, match="no runtime"):
        EmulatedProbe("javascript")

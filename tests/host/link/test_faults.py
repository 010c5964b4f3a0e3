"""Every fault of the link, put between the real firmware and the real client by the relay, from seeds."""

import threading
import time

import pytest

from palpate.link.flash import flash
from palpate.sim.probe.faults import Faults
from palpate.sim.probe.source import lifted_record
from palpate.wire.events import Estimate, Frame, Gap
from palpate.wire.packing import pack
from tests.host.probes import FRAMES, connect, settled
from tests.waiting import PATIENCE_S, wait_until

RARE = 1 / 5_000
"""Per byte: one frame in eight is hit."""
FAULTS = {
    "flip": Faults(flip=RARE),
    "lose": Faults(lose=RARE),
    "double": Faults(double=RARE),
    "swap": Faults(swap=RARE),
    "burst": Faults(burst=RARE / 2),
    "chatter": Faults(chatter=RARE),
    "stall": Faults(stall=RARE / 8, stall_s=0.15),
    "cut": Faults(cut=1 / 60_000),
}
ALL = Faults(flip=RARE / 8, lose=RARE / 8, double=RARE / 8, swap=RARE / 8, burst=RARE / 8, chatter=RARE / 8,
             stall=1 / 50_000, stall_s=0.1, cut=1 / 150_000)  # fmt: skip


@pytest.mark.parametrize("kind", [*FAULTS, "all"])
def test_what_comes_is_true_and_what_does_not_is_counted(emulated, images, strokes, kind):
    """Two strokes or more (a cut ends one); every frame is received or counted lost, estimates are whole."""
    faults = FAULTS.get(kind, ALL)
    device = emulated(to_host=faults, to_device=faults, seed=4, repeat=True)
    true = {bytes(p) for stroke in strokes for p in stroke.packed} | {lifted_record()[8:]}
    damages = kind in ("flip", "lose", "double", "swap", "burst")
    with connect(device) as probe:
        flash(probe, images[0])
        probe.set_setting("frame_rate", 100_000)
        frames, estimates, gaps = [], {}, 0
        for event in probe.stream(timeout_s=PATIENCE_S):
            if isinstance(event, Frame):
                frames.append(event)
            elif isinstance(event, Estimate):
                estimates[event.stroke] = event
            gaps += isinstance(event, Gap) and event.ended
            fault_counts = device.relay.to_host.fault_counts
            done = len(estimates) > 1 and (
                fault_counts[kind] if kind in FAULTS else min(fault_counts.values()) > 0
            )
            if done and len(frames) > 2 * FRAMES and (probe.frame_counts.lost or not damages):
                break
        told, counts = settled(probe), probe.frame_counts

        def every_gap_is_told():
            nonlocal gaps
            gaps += sum(isinstance(event, Gap) and event.ended for event in probe.events(0.0))
            return gaps == probe.counts.reconnects

        wait_until(every_gap_is_told, "a gap for each time that the link came back")
    assert all(frame.packed in true for frame in frames), "a frame was accepted wrong"
    assert len({f.seq for f in frames}) == len(frames) <= counts.received
    assert (gaps > 0) == (kind in ("cut", "all"))
    if damages:
        assert probe.counts.bad_crc + probe.counts.bad_frame + probe.counts.oversize > 0
        assert counts.lost > 0
    if kind == "stall":
        assert counts.lost == told["frames_dropped"], "what a stalled link cannot carry, the probe drops"
    assert all(e.model_id.hex() == probe.identity.model_id and e.valid for e in estimates.values())


def test_a_host_that_stops_reading_finds_the_newest_frames_and_every_result(emulated, images):
    """The transport is not read for seconds: the queues between fill up, the oldest frames give way."""
    with connect(emulated(repeat=True, roomy=False)) as probe:
        flash(probe, images[0])
        probe.set_setting("frame_rate", 400_000)
        reading, read = threading.Event(), probe._line.transport.read

        def lazy(timeout_s):
            reading.wait()
            return read(timeout_s)

        probe._line.transport.read = lazy
        reading.set()
        probe.start_stream()
        seen = [next(e for e in probe.events(PATIENCE_S) if isinstance(e, Frame))]

        def frames_gave_way():
            reading.clear()
            time.sleep(2)
            reading.set()
            return probe.statistics()["frames_dropped"] > 100

        wait_until(frames_gave_way, "a queue that is full")
        for event in probe.events(PATIENCE_S):
            seen.append(event)
            if len([e for e in seen if isinstance(e, Estimate)]) >= 8:
                break
        probe.stop_stream()
        told, counts = settled(probe), probe.frame_counts
    numbers = [e.stroke for e in seen if isinstance(e, Estimate)]
    assert len(set(numbers)) == len(numbers)
    lost = set(range(1, max(numbers) + 1)) - set(numbers)
    assert len(lost) <= told["estimates_given_up"]
    assert counts.lost == told["frames_dropped"] > 100


def test_the_same_seed_corrupts_the_same_bytes():
    from palpate.sim.probe.faults import FaultyLine

    data = b"".join(pack([k % 4096] * 416) for k in range(200))
    once, again, other = (FaultyLine(ALL, seed).pass_through(data) for seed in (1, 1, 2))
    assert once == again != other

"""What came, what is missing, when it was and how hard it pressed, each against a plain reckoning."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py import calib, geometry, messages
from palpate.wire.accounting import WINDOW, WRAP, LinkCounts, Sequence, StrokesTold
from palpate.wire.clock import ClockSync, Unwrapper
from palpate.wire.packing import pack, unpack
from palpate.wire.scale import NOMINAL, CalibrationPieces, CellScale

COUNTS = st.lists(st.integers(0, 4095), min_size=2, max_size=40).filter(lambda counts: len(counts) % 2 == 0)


@given(COUNTS)
def test_a_packed_frame_is_its_counts_twelve_bits_after_twelve_bits(counts):
    others = 4095 - np.array(counts)
    before, packed = pack(others), pack(np.array(counts))
    assert unpack(before).tolist() == others.tolist()
    assert unpack(packed).tolist() == counts and len(packed) == len(counts) * 3 // 2
    assert int.from_bytes(packed, "little") == sum(count << 12 * k for k, count in enumerate(counts))


def test_before_anything_came_nothing_is_counted():
    assert not any(LinkCounts().as_dict().values()) and not any(Sequence().counts.as_dict().values())
    assert StrokesTold().received == StrokesTold().lost == 0 and {"lost", "late"} < set(
        Sequence().counts.as_dict()
    )


@given(
    st.sampled_from([0, 77, WRAP - 20, WRAP - 1]),
    st.sampled_from([1, 2, 5]),
    st.lists(st.tuples(st.integers(0, 3), st.integers(-60, 60)), min_size=1, max_size=120),
    st.integers(0, 4),
)
def test_of_a_stream_every_number_is_received_lost_late_or_a_duplicate(start, every, sent, unsent):
    """Each number goes out none to three times, up to sixty places out of order; the last few never do."""
    order = sorted((k + by, k) for k, (times, by) in enumerate(sent) for _ in range(times))
    counter, seen, late, doubles, skipped = Sequence(), set(), 0, 0, 0
    counter.every = every
    counter.expect_from(start)
    newest = -1
    for _, k in order:
        fresh = k not in seen
        assert counter.add((start + k * every) % WRAP) == fresh
        assert counter.gap == (k - newest - 1 if k > newest else 0)
        skipped += counter.gap
        late += fresh and k < newest
        doubles += not fresh
        newest = max(newest, k)
        seen.add(k)
    counter.expect_until((start + (len(sent) + unsent) * every) % WRAP)
    counts = counter.counts
    assert (counts.received, counts.late, counts.duplicate) == (len(seen), late, doubles)
    assert counts.lost == len(sent) + unsent - len(seen) and counts.restarts == 0
    for k in range(len(sent) + unsent):  # and what comes after the end is known, too
        assert counter.add((start + k * every) % WRAP) == (k not in seen)
    assert counts.lost == 0 and counts.received == len(sent) + unsent


def test_a_number_is_late_within_the_window_and_a_restart_beyond_it():
    for behind, restarts in ((WINDOW - 1, 0), (WINDOW, 1)):
        counter = Sequence()
        counter.expect_from(0)
        counter.add(1000)
        assert counter.counts.lost == 1000
        assert counter.add(1000 - behind)
        assert counter.counts.restarts == restarts and counter.counts.late == 1 - restarts
        assert counter.counts.lost == 1000 - (1 - restarts) and counter.counts.received == 2
    counter.add(1000 - WINDOW + 1)
    assert counter.counts.lost == 1000, "after a restart the next number follows"


def test_a_message_two_hundred_behind_is_late_and_no_restart():
    """The probe's outbox and the operating system's buffers hold as many."""
    counted = Sequence()
    for number in (*range(50), *range(51, 251)):
        assert counted.add(number)
    assert counted.add(50)
    assert (counted.counts.late, counted.counts.lost, counted.counts.restarts) == (1, 0, 0)


def test_a_new_connection_is_no_gap():
    counter = Sequence()
    counter.add(5)
    counter.restart()
    counter.expect_until(900)
    assert counter.add(700) and counter.counts.lost == 0 and counter.gap == 0


@given(st.lists(st.lists(st.booleans(), min_size=1, max_size=6), min_size=1, max_size=14))
def test_estimates_of_many_streams_are_counted_however_many_there_were(streams):
    strokes = StrokesTold()
    for stream, came in enumerate(streams):
        strokes.begin(stream, 100)
        for k, yes in enumerate(came):
            if yes:
                strokes.came(stream, 100 + k)
        strokes.end(stream, 100 + len(came))
    everything = [yes for came in streams for yes in came]
    received, lost = sum(everything), len(everything) - sum(everything)
    assert (strokes.received, strokes.lost) == (received, lost)
    if not streams[-1][0]:  # one that came after its stream had ended
        strokes.came(len(streams) - 1, 100)
        assert (strokes.received, strokes.lost) == (
            sum(everything) + 1,
            len(everything) - sum(everything) - 1,
        )
    strokes.came(99, 1)
    strokes.end(99, 7)
    assert strokes.received + strokes.lost == len(everything), "of a stream that nobody began"


def test_a_value_belongs_to_the_turn_nearest_to_what_the_hosts_clock_expects():
    clock = Unwrapper()
    assert clock(WRAP - 10, 50) == WRAP - 10, "the first is taken as it comes"
    assert clock(5, 65) == WRAP + 5
    assert clock(WRAP - 3, 70) == WRAP - 3, "late, of the turn before"
    assert clock(6, 66) == WRAP + 6
    assert clock(6, 66 + 3 * WRAP) == 4 * WRAP + 6
    assert clock(7, 0) == 4 * WRAP + 7, "the host's clock went back: that is no time"
    half = WRAP // 2
    assert clock(7 + half - 1, 1 + half) == 4 * WRAP + 7 + half - 1
    without = Unwrapper()
    told = [without(value) for value in (3, half, WRAP - 1, 2)]
    assert told == [3, half, WRAP - 1, WRAP + 2]


def test_values_that_come_late_leave_the_turn_as_it_was():
    unwrapped = Unwrapper()
    told = (0, 500_000_000, 100_000_000, 700_000_000, WRAP - 1, 900_000_000, 350_000_000)
    assert [unwrapped(value) for value in told] == [*told[:-1], WRAP + told[-1]]


def test_a_probe_that_says_it_took_longer_than_the_whole_exchange_is_not_known_better_than_exactly():
    sync = ClockSync()
    sync.add(1000, 0, 5000, 1200)
    assert sync.state.uncertainty_us == 0
    over_the_wrap = ClockSync()
    over_the_wrap.add(2_000_000, WRAP - 10, 30, 2_000_100)
    assert over_the_wrap.state.uncertainty_us == 30


def test_a_board_that_is_emulated_slowly_has_its_turns_counted_in_its_own_time():
    sync = ClockSync(times_slower=70.0)
    for probe in (0, 600_000_000, 1_400_000_000):
        sync.add(70 * probe - 50, probe % WRAP, probe % WRAP, 70 * probe + 50)
    assert sync.state.at_probe_us == 1_400_000_000


def test_exchanges_that_are_slow_one_way_only_do_not_shift_the_clock():
    sync = ClockSync(min_span_s=2.0)
    for k in range(40):
        probe, slow = 500_000 * k, 1000 * (k % 2)
        sync.add(7e8 + probe - 100 - slow, probe, probe, 7e8 + probe + 100)
    assert sync.state.exchanges == 20
    assert sync.state.offset_us == pytest.approx(7e8, abs=1)


def test_exchanges_that_took_long_count_for_nothing_and_half_the_quickest_is_the_uncertainty():
    sync, offset = ClockSync(min_span_s=2.0), 5e12
    assert sync.state is None and sync.host_time_us(4) is None
    for k in range(20):
        probe, slow = 500_000 * k + WRAP - 3_000_000, 40_000 * (k % 2)
        asked = offset + probe - 100 - slow
        sync.add(asked, probe % WRAP, (probe + 30) % WRAP, offset + probe + 30 + 100)
    state = sync.state
    assert state.uncertainty_us == pytest.approx(100) and state.exchanges == 10
    assert state.offset_us == pytest.approx(offset, abs=1) and state.drift_ppm == pytest.approx(0, abs=0.1)
    assert sync.host_time_us(WRAP + 77_000) == pytest.approx(offset + WRAP + 77_000, abs=1)
    sync.restart()
    assert sync.state is None
    sync.add(1000, 40, 40, 1600)
    assert sync.state.offset_us == 1260 and sync.state.uncertainty_us == 300 and sync.state.exchanges == 1
    assert sync.host_time_us(1040) == pytest.approx(2300), "its clock began anew"


@pytest.mark.parametrize("ppm", [-60.0, 200.0])
def test_a_probes_clock_that_gains_or_loses_is_followed_between_and_beyond_the_exchanges(ppm):
    sync = ClockSync(keep=16)
    for k in range(80):
        host = 1e6 * k + 7e8 + (3e6 if k < 40 else 0)  # what is long ago counts no more
        probe = round(1e6 * k * (1 + ppm * 1e-6)) + 123
        sync.add(host - 50, probe, probe, host + 50)
    assert sync.state.drift_ppm == pytest.approx(ppm, abs=0.5) and sync.state.exchanges == 16
    for k in (70, 75, 95):
        probe = 1e6 * k * (1 + ppm * 1e-6) + 123
        assert sync.host_time_us(round(probe)) == pytest.approx(1e6 * k + 7e8, abs=3)


def test_a_clock_that_is_known_for_too_short_a_time_has_no_drift():
    sync = ClockSync(min_span_s=5.0)
    for k in range(5):
        sync.add(1e6 * k - 50, 1_100_000 * k, 1_100_000 * k, 1e6 * k + 50)
    assert sync.state.drift_ppm == 0.0
    sync.add(5e6 - 50, 5_500_000, 5_500_000, 5e6 + 50)
    assert sync.state.drift_ppm == pytest.approx(1e5, rel=1e-3)
    two = ClockSync()
    for at, seconds in enumerate((0, 60), 1):
        two.add(1e6 * seconds - 50, 1_100_000 * seconds, 1_100_000 * seconds, 1e6 * seconds + 50)
        assert two.state.drift_ppm == 0.0 and two.state.exchanges == at, "two points say nothing of a rate"


def test_the_last_sixty_four_exchanges_count():
    sync = ClockSync()
    for k in range(100):
        sync.add(1e6 * k - 50, 1_000_000 * k, 1_000_000 * k, 1e6 * k + 50)
    assert sync.state.exchanges == 64


def calibration(rng):
    made = calib.Calibration()
    made.count_mpa = 7_000_000
    for k in range(geometry.CELLS):
        made.offset[k] = int(rng.integers(0, 900))
        made.gain[k] = int(calib.UNIT_GAIN * rng.uniform(0.8, 1.25))
    return made


def test_a_pressure_is_the_count_less_the_zero_times_the_gain():
    made = calibration(np.random.default_rng(2))
    scale = CellScale()
    assert not scale.calibrated
    counts = np.random.default_rng(3).integers(0, 4096, (geometry.ROWS, geometry.COLUMNS)).astype(np.uint16)
    before = scale.kPa(counts).copy()
    assert scale.load(made.to_bytes()) and scale.calibrated
    flat = counts.reshape(-1).astype(float)
    true = [
        (flat[k] - made.offset[k] / 8) * made.gain[k] / calib.UNIT_GAIN * 7.0 for k in range(geometry.CELLS)
    ]
    np.testing.assert_allclose(scale.kPa(counts).reshape(-1), true, rtol=1e-5, atol=1e-3)
    blob = bytearray(made.to_bytes())
    blob[0] ^= 1
    assert not scale.load(bytes(blob)) and scale.calibrated
    np.testing.assert_allclose(scale.kPa(counts).reshape(-1), true, rtol=1e-5, atol=1e-3)
    assert not np.allclose(before.reshape(-1), true), "the nominal sensor's were others"
    np.testing.assert_array_equal(NOMINAL.kPa(counts), before)
    packed = pack(counts)
    np.testing.assert_array_equal(scale.kPa_of(packed), scale.kPa(counts))
    assert not scale.kPa_of(packed).flags.writeable
    other = pack((counts + 7) % 4096)
    np.testing.assert_array_equal(scale.kPa_of(other), scale.kPa((counts + 7) % 4096))
    again = calibration(np.random.default_rng(5))
    scale.load(again.to_bytes())
    assert not np.allclose(scale.kPa_of(packed).reshape(-1), true), "the image that it had is of before"


def test_a_dead_cell_reads_what_its_neighbours_say():
    made, scale, dead = calib.Calibration(), CellScale(), [27, 200, 205]
    row, column = np.indices((geometry.ROWS, geometry.COLUMNS))
    counts = (1000 + 40 * column + 25 * row).astype(np.uint16)
    assert scale.load(made.to_bytes())
    true = scale.kPa(counts).reshape(-1).copy()
    made.set_dead(dead)
    counts.reshape(-1)[dead] = 3000
    assert scale.load(made.to_bytes())
    np.testing.assert_allclose(scale.kPa(counts).reshape(-1), true, rtol=1e-5)


def test_a_calibration_is_put_together_from_one_reading_alone():
    one, two = (calibration(np.random.default_rng(seed)).to_bytes() for seed in (1, 2))
    step = 300
    places = range(0, len(one), step)
    pieces = CalibrationPieces()

    def add(blob, at, what=messages.READ_CALIBRATION, size=calib.BLOB_BYTES):
        return pieces.add(what, at, size, blob[at : at + step])

    assert not any(add(one, at) for at in places[:-1])
    assert add(one, places[-1], what=messages.READ_CALIBRATION + 1) is None
    assert add(one, places[-1], size=len(one) - 1) is None and add(one, 0, size=step) is None
    assert pieces.add(messages.READ_CALIBRATION, places[-1], len(one), one[places[-1] :] + b"x") is None
    whole = add(one, places[-1])
    assert whole is not None and bytes(whole._calibration.to_bytes()) == one, (
        "what was no answer changed nothing"
    )
    assert not any(add(one, at) for at in places[:-1])
    assert add(two, 0) is None and add(one, places[-1]) is None, "of two readings none is made"
    for at in reversed(places[1:]):
        done = add(two, at)
    assert done is not None and bytes(done._calibration.to_bytes()) == two
    assert add(two, places[-1]) is None, "the next reading begins with nothing"
    add(one, 0)
    pieces.forget()
    assert not any(add(one, at) for at in places[1:])

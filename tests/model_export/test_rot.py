"""Flipped bits in what the probe has stored are repaired or told; no counter falls by them."""

from __future__ import annotations

import pytest

from firmware_py import calib, estimator, messages, safe_record, slots, status
from firmware_py import flash as firmware_flash
from palpate.model_export.signing import keys
from palpate.sim.probe.flash_sim import FlashSim
from tests.campaigns import counted
from tests.model_export import small_key
from tests.model_export.flashing import flash, flipped, model_id, probe_of


def settled(files, key):
    """A probe that has started with these files, as firmware_py.flash starts it."""
    return firmware_flash.Flash(FlashSim(files), key).slots


@pytest.fixture
def files(signed, public_key):
    """A probe's store: two models flashed, the second live."""
    store = FlashSim()
    probe = probe_of(store, public_key)
    for counter in (2, 3):
        assert flash(probe, signed[counter]) == status.OK
    return store.files


@pytest.mark.parametrize("name", ["live0", "live1"])
def test_no_flip_in_a_record_of_what_is_live_rolls_back_model_or_counter(files, signed, public_key, name):
    """264 of 264 did, in the newest copy, and an older image was accepted."""
    for bit in range(8 * len(files[name])):
        probe = settled(flipped(files, name, bit), public_key)
        assert probe.live_id() == model_id(signed[3]) and probe.health == status.REPAIRED
        assert flash(probe, signed[1]) == status.TOO_OLD
        # and it is whole again: the next start finds nothing
        again = settled(probe.store.files, public_key)
        assert again.health == status.OK and again.live_id() == model_id(signed[3])


def test_flips_in_both_copies_lose_nothing_that_the_slots_can_tell(files, signed, public_key):
    for bit in range(0, 8 * len(files["live0"]), 5):
        both = flipped(flipped(files, "live0", bit), "live1", (7 * bit) % (8 * len(files["live1"])))
        probe = settled(both, public_key)
        assert probe.live_id() == model_id(signed[3]) and probe.health == status.ROTTEN
        assert flash(probe, signed[1]) == status.TOO_OLD
        assert settled(probe.store.files, public_key).health == status.OK


def test_after_a_rollback_the_counter_comes_back_from_what_it_replaced(signed, public_key):
    store = FlashSim()
    probe = probe_of(store, public_key)
    for counter in (3, -1):
        assert flash(probe, signed[counter]) == status.OK
    probe = settled(flipped(flipped(store.files, "live0", 40), "live1", 90), public_key)
    assert any(probe.live_id())
    assert flash(probe, signed[2]) == status.TOO_OLD


@pytest.mark.parametrize("step", [331, pytest.param(1, marks=pytest.mark.long)])
def test_a_damaged_live_image_is_told_and_the_one_before_serves(files, public_key, signed, step):
    bits = range(0, 8 * len(signed[3]), step)
    for bit in bits:
        probe = settled(flipped(files, slots.NAMES[1], bit), public_key)
        assert probe.health == status.ROTTEN and probe.live_id() == model_id(signed[2])
    counted(f"{len(bits)} flips")


class Store(FlashSim):
    """A store with a calibration of its own."""

    def __init__(self, files=None):
        super().__init__(files)
        if files is None:
            own = calib.Calibration()
            for first in (600, 700):  # the older one would do as badly as the nominal one
                own.offset[5] = first
                assert safe_record.Record(self, "cal").save(own.to_bytes()) == status.OK


@pytest.mark.parametrize("step", [37, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", ["cal0", "cal1"])
def test_no_flip_in_a_copy_of_the_calibration_changes_it(name, step):
    """376 of 376 fell back to the older one, or to nominal gains, and nobody was told."""
    files = Store().files
    bits = range(0, 8 * len(files[name]), step)
    for bit in bits:
        made = estimator.Estimator(Store(flipped(files, name, bit)))
        assert made.calibration.offset[5] == 700
        assert made.health() == status.REPAIRED and made.damage() == messages.DAMAGE_REPAIRED
    counted(f"{len(bits)} flips")


def test_a_calibration_lost_in_both_copies_is_told_until_there_is_a_new_one():
    files = Store().files
    made = estimator.Estimator(Store(flipped(flipped(files, "cal0", 99), "cal1", 1234)))
    assert made.calibration.offset[5] == calib.PEDESTAL
    assert made.damage() == messages.DAMAGED_CALIBRATION and made.health() == status.ROTTEN
    assert made._keep(calib.Calibration(), messages.CALIBRATE_CLEAR, 0, 0)[0] == status.OK
    assert not made.damage()


def test_a_model_that_was_being_tried_when_the_probe_restarted_is_told_and_not_live(signed, public_key):
    """A trial that hangs is reverted: a watchdog restarts the board, and the old model is live."""
    store = FlashSim()
    probe = probe_of(store, public_key)
    assert flash(probe, signed[1]) == status.OK
    assert probe.begin(len(signed[2])) == status.OK
    probe.write(0, signed[2])
    assert probe.verify() == status.OK
    assert store.files[slots.TRIAL] == model_id(signed[2])
    after = settled(store.files, public_key)  # here it hung
    assert after.live_id() == model_id(signed[1]) and after.health == status.TRIAL_HUNG
    again = settled(after.store.files, public_key)
    assert again.health == status.OK
    assert flash(again, signed[2]) == status.OK and slots.TRIAL not in again.store.files


# -- a key's successor


@pytest.fixture
def succession(key_dir, tmp_path):
    new = keys.generate(tmp_path / "new", small_key.secret(7))
    return new, keys.succeed(key_dir, new), tmp_path / "new"


def test_a_successor_takes_the_old_keys_place_and_the_live_model_stays(
    thesis, signed, public_key, succession
):
    from palpate.model_export.exporter import export

    new, file, home = succession
    store = FlashSim()
    probe = probe_of(store, public_key)
    assert flash(probe, signed[3]) == status.OK
    assert flash(probe, file) == status.OK
    assert probe.state == slots.IDLE and slots.NAMES[1] not in store.files, "it is no model: its room is free"
    for _ in range(2):
        assert probe.live_id() == model_id(signed[3])
        assert flash(probe, signed[-1]) == status.BAD_SIGNATURE  # the old key's models are no longer taken
        assert flash(probe, file) == status.BAD_SIGNATURE  # nor is its word for another key
        probe = probe_of(FlashSim(store.files), public_key)
    of_new = export(thesis, home, counter=4)[0]
    assert flash(probe, of_new) == status.OK
    again = probe_of(FlashSim(probe.store.files), public_key)
    assert again.live_id() == model_id(of_new) and again.keys.current == new


def test_only_the_current_key_may_name_a_successor(public_key, succession, tmp_path):
    stranger = tmp_path / "stranger"
    keys.generate(stranger, small_key.secret(9))
    forged = keys.succeed(stranger, succession[0])
    probe = probe_of(FlashSim(), public_key)
    assert flash(probe, forged) == status.BAD_SIGNATURE
    for bit in range(0, 8 * len(succession[1]), 41):
        data = bytearray(succession[1])
        data[bit // 8] ^= 1 << bit % 8
        assert flash(probe, bytes(data)) != status.OK
    assert probe.keys.current == public_key


def test_of_several_things_that_a_start_finds_the_worst_is_told(public_key, succession, signed):
    store = FlashSim()
    probe = probe_of(store, public_key)
    assert flash(probe, signed[3]) == flash(probe, succession[1]) == status.OK
    one_key, one_record = flipped(store.files, "key0", 300), flipped(store.files, "live0", 40)
    hung = {slots.TRIAL: bytes(8)}
    for files, worst in (
        (store.files, status.OK),
        (one_key, status.REPAIRED),
        (one_record, status.REPAIRED),
        ({**one_key, "live0": one_record["live0"]}, status.REPAIRED),
        ({**one_record, **hung}, status.TRIAL_HUNG),
        ({**flipped(one_key, "key1", 700), "live0": one_record["live0"]}, status.ROTTEN),
        ({**flipped(one_key, "key1", 700), **hung}, status.ROTTEN),
    ):
        assert probe_of(FlashSim(files), public_key).health == worst


@pytest.mark.parametrize("step", [29, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", ["key0", "key1"])
def test_no_flip_in_a_copy_of_the_keys_changes_whose_models_are_taken(public_key, succession, name, step):
    store = FlashSim()
    assert flash(probe_of(store, public_key), succession[1]) == status.OK
    bits = range(0, 8 * len(store.files[name]), step)
    for bit in bits:
        probe = settled(flipped(store.files, name, bit), public_key)
        assert probe.keys.current == succession[0] and probe.health == status.REPAIRED
        assert settled(probe.store.files, public_key).health == status.OK
    counted(f"{len(bits)} flips")


def test_with_its_record_lost_no_key_is_believed_and_a_new_installation_starts_afresh(
    public_key, succession, signed
):
    store = FlashSim()
    probe = probe_of(store, public_key)
    assert flash(probe, succession[1]) == status.OK
    one = settled(flipped(store.files, "key0", 300), public_key)
    assert one.keys.current == succession[0] and one.health == status.REPAIRED
    lost = probe_of(FlashSim(flipped(flipped(store.files, "key0", 300), "key1", 700)), public_key)
    assert lost.health == status.ROTTEN
    # above all not the key that was given up
    assert flash(lost, signed[1]) != status.OK
    other, _ = small_key.signer(11)
    assert probe_of(FlashSim(store.files), other).keys.current == other


def test_a_cut_at_any_byte_of_a_succession_leaves_the_old_key_or_the_new(public_key, succession, signed):
    from palpate.sim.probe.flash_sim import cut_states

    store = FlashSim()
    flash(probe_of(store, public_key), signed[1])
    before = dict(store.files)
    store = FlashSim(before)
    assert flash(probe_of(store, public_key), succession[1]) == status.OK
    seen = set()
    for _number, _mode, left in cut_states(before, store.trace):
        records = {n: left.get(n) for n in ("key0", "key1")}
        if (key := tuple(records.items())) in seen:
            continue
        seen.add(key)
        probe = probe_of(FlashSim(left), public_key)
        assert probe.keys.current in (public_key, succession[0])
        assert probe.live_id() == model_id(signed[1])


def test_where_an_old_key_is_taken_back_its_first_succession_is_not(public_key, key_dir, succession):
    """After old -> new -> old anyone could send the first one again."""
    new, first, home = succession
    store = FlashSim()
    probe = probe_of(store, public_key)
    back = keys.succeed(home, public_key)
    assert flash(probe, first) == status.OK and flash(probe, back) == status.OK
    for _ in range(2):
        assert probe.keys.current == public_key
        assert flash(probe, first) == status.TOO_OLD
        assert flash(probe, back) == status.BAD_SIGNATURE
        probe = settled(store.files, public_key)
    assert flash(probe, keys.succeed(key_dir, new)) == status.OK and probe.keys.current == new


def test_a_record_of_the_firmware_before_is_read_and_a_succession_of_any_moment_taken(
    public_key, key_dir, succession
):
    other = small_key.signer(11)[0]
    store = FlashSim()
    probe = probe_of(store, public_key)
    assert probe.keys.record.save(public_key + public_key + other) == status.OK
    probe = settled(store.files, public_key)
    assert probe.keys.current == public_key and probe.keys.before == other
    assert flash(probe, keys.succeed(key_dir, succession[0], moment_ns=1)) == status.OK

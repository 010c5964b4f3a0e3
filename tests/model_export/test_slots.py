"""The slots as the probe's link uses them: what is accepted, what is refused, and what stays live."""

from __future__ import annotations

import pytest

from firmware_py import forcemap, model_image, signature, slh_dsa, slots, status
from firmware_py.store import FileStore
from palpate.link import emulator_model as emulator
from palpate.model_export import image_builder as host_image
from palpate.model_export.integers.force_map import blob as pack_force_map
from palpate.sim.probe.flash_sim import FlashSim
from tests.model_export import small_key
from tests.model_export.flashing import a_force_map, flash, model_id, probe_of, send


@pytest.fixture(scope="module")
def signer():
    """Signs any bytes with a small key of its own: (public key, sign)."""
    return small_key.signer(1)


@pytest.fixture(params=["memory", "files"])
def store(request, tmp_path):
    return FlashSim() if request.param == "memory" else FileStore(str(tmp_path))


def test_a_new_probe_has_no_model_then_the_one_flashed_and_keeps_it_over_a_restart(store, signed, public_key):
    probe = probe_of(store, public_key)
    assert probe.live() is None and probe.live_id() == bytes(8)
    assert flash(probe, signed[1]) == status.OK
    assert probe.live_id() == model_id(signed[1])
    again = probe_of(store, public_key)
    assert again.live_id() == model_id(signed[1])
    assert b"".join(again.read(at, 100) for at in range(0, again.live_size(), 100)) == signed[1]


def test_models_take_turns_in_the_two_slots(store, signed, public_key):
    probe = probe_of(store, public_key)
    for counter in (1, 2, 3):
        assert flash(probe, signed[counter]) == status.OK
        assert probe_of(store, public_key).live_id() == model_id(signed[counter])


def test_a_model_is_not_live_before_it_is_confirmed(store, signed, public_key):
    probe = probe_of(store, public_key)
    flash(probe, signed[1])
    send(probe, signed[2])
    assert probe.confirm() == probe.try_() == status.BAD_STATE
    assert probe.verify() == probe.verify() == status.OK
    assert probe.confirm() == status.BAD_STATE
    assert probe.try_() == probe.try_() == status.OK
    assert probe.live_id() == model_id(signed[1])
    assert probe_of(store, public_key).live_id() == model_id(signed[1])
    probe.abort()
    assert probe.live_id() == model_id(signed[1])


def test_an_older_image_is_refused_unless_signed_as_a_rollback(store, signed, public_key):
    probe = probe_of(store, public_key)
    assert flash(probe, signed[3]) == status.OK
    for old in (1, 2):
        assert flash(probe, signed[old]) == status.TOO_OLD
        assert probe_of(store, public_key).live_id() == model_id(signed[3])
    assert flash(probe, signed[-1]) == status.OK
    assert probe.live_id() == model_id(signed[-1])
    # the rollback does not open the way for the others
    assert flash(probe, signed[2]) == status.TOO_OLD
    assert flash(probe_of(store, public_key), signed[2]) == status.TOO_OLD
    assert flash(probe, signed[3]) == status.OK


def test_a_rollback_reaches_no_further_than_it_says(thesis, thesis_tables, signer):
    key, sign = signer
    new = sign(host_image.build(thesis, thesis_tables, None, 9))
    rollback = sign(host_image.build(thesis, thesis_tables, None, 2, 8))
    probe = probe_of(FlashSim(), key)
    assert flash(probe, rollback) == status.OK
    assert flash(probe, new) == status.OK
    assert flash(probe, rollback) == status.TOO_OLD


def test_an_image_that_says_what_it_replaces_and_is_no_rollback_is_no_model(thesis, thesis_tables, signer):
    key, sign = signer
    probe = probe_of(FlashSim(), key)
    assert flash(probe, sign(host_image.build(thesis, thesis_tables, None, 5))) == status.OK
    older = changed(host_image.build(thesis, thesis_tables, None, 2), 16, 99)
    assert flash(probe, sign(older)) == status.BAD_MODEL


def test_a_live_model_that_rots_while_another_is_tried_is_told_and_a_new_one_mends_it(signed, public_key):
    probe = probe_of(FlashSim(), public_key)
    flash(probe, signed[1])
    send(probe, signed[2])
    name = slots.NAMES[0]
    probe.store.files[name] = changed(probe.store.files[name], 200, probe.store.files[name][200] ^ 8)
    assert probe.verify() == probe.try_() == status.OK
    assert probe.live() is None and probe.health == status.ROTTEN
    assert probe.confirm() == status.OK
    assert probe.live_id() == model_id(signed[2]) and probe.health == status.OK


def test_pieces_may_come_twice_but_not_early_and_not_too_many(signed, public_key):
    probe = probe_of(FlashSim(), public_key)
    data = signed[1]
    assert probe.write(0, b"x") == probe.verify() == status.BAD_STATE
    assert probe.begin(len(data)) == status.OK
    assert probe.write(0, data[:100]) == status.OK
    assert probe.write(40, data[40:130]) == status.OK and probe.received == 130
    assert probe.write(131, data[131:140]) == status.BAD_VALUE
    assert probe.verify() == status.BAD_STATE
    # after a break of the link the transfer goes on
    assert probe.begin(len(data)) == status.OK and probe.received == 130
    assert probe.write(130, data[130:] + b"!") == status.BAD_VALUE
    assert probe.write(130, data[130:]) == status.OK
    assert probe.verify() == status.OK


def test_sizes_that_cannot_be_are_refused_at_once(public_key):
    probe = probe_of(FlashSim(), public_key, max_size=8192)
    assert probe.begin(8193) == status.NO_SPACE
    assert probe.begin(signature.size(public_key)) == status.BAD_SIGNATURE
    assert probe.begin(0) == probe.begin(-1) == status.BAD_VALUE


def test_a_full_store_keeps_the_old_model(signed, public_key):
    store = FlashSim(full_at=len(signed[1]) + 500)
    probe = probe_of(store, public_key)
    assert flash(probe, signed[1]) == status.OK
    assert probe.begin(len(signed[2])) == status.OK
    code = status.OK
    for at in range(0, len(signed[2]), 48):
        code = probe.write(at, signed[2][at : at + 48])
        if code != status.OK:
            break
    assert code == status.NO_SPACE and probe.state == slots.IDLE
    assert probe.write(at, signed[2][at : at + 48]) == status.BAD_STATE, "how much of it arrived is unknown"
    assert probe_of(store, public_key).live_id() == model_id(signed[1])


def test_a_slot_takes_an_image_of_its_own_size(signed, public_key):
    size = len(signed[1])
    probe = probe_of(FlashSim(), public_key, max_size=size)
    assert flash(probe, signed[1]) == status.OK and probe.begin(size + 1) == status.NO_SPACE


def test_another_image_takes_the_place_of_the_one_on_its_way_and_a_refused_one_ends_it(signed, public_key):
    probe = probe_of(FlashSim(), public_key)
    size = len(signed[1])
    assert probe.begin(size + 1) == probe.write(0, signed[1][:100]) == status.OK
    assert probe.begin(size) == status.OK and probe.received == 0
    assert probe.write(0, signed[1][:100]) == status.OK
    assert probe.begin(0) == status.BAD_VALUE
    assert probe.state == slots.IDLE and not probe.store.files
    assert probe.write(100, signed[1][100:200]) == status.BAD_STATE


def test_what_the_store_lost_or_exchanged_is_not_made_live(signed, public_key):
    probe = probe_of(FlashSim(), public_key)
    flash(probe, signed[1])
    send(probe, signed[2])
    probe.store.files[slots.NAMES[1]] = signed[2][:-1]
    assert probe.verify() == status.STORE_ERROR
    send(probe, signed[2])
    assert probe.verify() == probe.try_() == status.OK
    probe.store.files[slots.NAMES[1]] = signed[3]  # whole, signed, and not what was tried
    assert probe.confirm() == status.STORE_ERROR
    assert probe.live_id() == model_id(signed[1])


def test_the_live_models_tables_are_out_of_the_way_while_those_of_the_new_one_are_read(signed, public_key):
    """A board has no room for both: every model that comes with Palpate was refused."""
    probe = probe_of(FlashSim(), public_key)
    flash(probe, signed[1])
    send(probe, signed[2])
    read, alone = probe.store.read, []

    def watched(name, offset, n):
        if name == slots.NAMES[1]:
            alone.append(probe.model is None)
        return read(name, offset, n)

    probe.store.read = watched
    assert probe.verify() == status.OK and alone[-1] and not alone[0], "the signature needs no table"
    assert probe.try_() == status.OK and probe.live_id() == model_id(signed[1])
    alone.clear()
    assert probe.confirm() == status.OK and all(alone)
    assert probe.live_id() == model_id(signed[2])


def test_a_reference_press_outlives_another_models_trial():
    image = emulator.image()
    probe = probe_of(FlashSim(), emulator.public_key())
    assert flash(probe, image) == status.OK
    probe.live().first.set(5, -6, 7)
    send(probe, image)
    assert probe.verify() == probe.try_() == probe.abort() == status.OK
    assert tuple(probe.live().first.reference) == (5, -6, 7)


def test_a_store_that_has_no_place_for_an_image_says_so_before_it_is_sent(signed, public_key, monkeypatch):
    probe = probe_of(FlashSim(), public_key)
    monkeypatch.setattr(probe.store, "create", lambda name, data=b"": status.STORE_ERROR)
    assert probe.begin(len(signed[1])) == status.STORE_ERROR
    assert probe.state == slots.IDLE and probe.write(0, signed[1][:48]) == status.BAD_STATE


def test_a_bad_signature_is_refused(signed, public_key):
    data = bytearray(signed[2])
    data[700] ^= 1
    probe = probe_of(FlashSim(), public_key)
    flash(probe, signed[1])
    assert flash(probe, bytes(data)) == status.BAD_SIGNATURE
    assert probe.state == slots.IDLE and probe.live_id() == model_id(signed[1])


def changed(body: bytes, at: int, value: int) -> bytes:
    data = bytearray(body)
    data[at] = value
    return bytes(data)


def test_what_is_rightly_signed_may_still_not_fit_this_probe(thesis, thesis_tables, signer):
    key, sign = signer
    body = host_image.build(thesis, thesis_tables, None, 1)
    probe = probe_of(FlashSim(), key)
    ids = body.index(bytes(thesis_tables.ids), model_image.HEAD_SIZE)
    for other, wanted in (
        (changed(body, 0, 0), status.BAD_MAGIC),
        (changed(body, 4, 9), status.BAD_VERSION),
        (changed(body, 6, 99), status.BAD_VERSION),
        (changed(body, 24, 65), status.BAD_PROBE),
        (changed(body, 8, body[8] ^ 4), status.BAD_LENGTH),
        (changed(body, ids, 255), status.MISSING_FEATURE),
        (changed(body, 80, body[80] ^ 8), status.BAD_LENGTH),
    ):
        assert flash(probe, sign(other)) == wanted
    assert flash(probe, sign(body)) == status.OK


def test_a_model_whose_own_vectors_fail_is_not_confirmed(thesis, thesis_tables, signer):
    key, sign = signer
    body = host_image.build(thesis, thesis_tables, None, 1)
    wrong = bytearray(body)
    wrong[-3] ^= 1  # inside the last stated integer
    probe = probe_of(FlashSim(), key)
    assert flash(probe, sign(bytes(wrong))) == status.SELF_TEST
    assert probe.live() is None and probe.state == slots.IDLE and not probe.store.files
    assert flash(probe, sign(body)) == status.OK


def test_a_damaged_live_slot_gives_way_to_the_model_before(signed, public_key):
    store = FlashSim()
    probe = probe_of(store, public_key)
    flash(probe, signed[1])
    flash(probe, signed[2])
    name = slots.NAMES[1]
    store.files[name] = changed(store.files[name], 200, store.files[name][200] ^ 8)
    probe = probe_of(store, public_key)
    assert probe.live_id() == model_id(signed[1])
    # and a new one goes to the damaged slot, not over the one that serves
    assert flash(probe, signed[3]) == status.OK
    assert probe_of(store, public_key).live_id() == model_id(signed[3])


def test_a_model_whose_own_vectors_fail_is_not_started_either(thesis, thesis_tables, signer):
    """Its record is lost, and it is the newest that is signed: the other slot's model serves."""
    key, sign = signer
    good, newer = (host_image.build(thesis, thesis_tables, None, counter) for counter in (1, 2))
    wrong = bytearray(newer)
    wrong[-3] ^= 1  # inside the last stated integer
    probe = probe_of(FlashSim(), key)
    assert flash(probe, sign(good)) == status.OK
    files = {**probe.store.files, slots.NAMES[1]: sign(bytes(wrong)), "live0": b"?", "live1": b"?"}
    again = probe_of(FlashSim(files), key)
    assert again.live_id() == model_id(good) and again.health == status.ROTTEN


def test_a_slot_put_back_to_an_older_image_is_not_started(signed, public_key):
    store = FlashSim()
    probe = probe_of(store, public_key)
    flash(probe, signed[2])
    flash(probe, signed[3])
    store.files[slots.NAMES[1]] = signed[1]
    store.files[slots.NAMES[0]] = signed[1]
    assert probe_of(store, public_key).live() is None


def test_without_sha256_it_says_not_supported(monkeypatch, signed, public_key):
    probe = probe_of(FlashSim(), public_key)
    monkeypatch.setattr(slh_dsa, "sha256", None)
    assert probe.begin(len(signed[1])) == status.NOT_SUPPORTED
    assert probe_of(FlashSim(), public_key).live() is None


def test_the_force_map_and_kind_travel(field, field_tables, signer):
    key, sign = signer
    blob = pack_force_map(a_force_map())
    body = host_image.build(field, field_tables, blob, 1)
    probe = probe_of(FlashSim(), key)
    assert flash(probe, sign(body)) == status.OK
    assert probe.live().force_map == forcemap.load(blob)
    assert probe.live().kind == 1

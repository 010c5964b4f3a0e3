"""Records that survive every cut of power: settings, calibration; and the simulated flash itself."""

from __future__ import annotations

import pytest

from firmware_py import crc, safe_record, status
from palpate.sim.probe import flash_sim
from palpate.sim.probe.flash_sim import FlashSim, cut_states
from tests.campaigns import counted
from tests.model_export.remembering import remember_signatures

__all__ = ["remember_signatures"]


def records_left(files):
    return safe_record.Record(FlashSim(files), "cal").load()


@pytest.mark.parametrize("number", [255, 65_535, (1 << 24) - 1])
def test_the_copy_with_the_higher_number_is_the_newer_one(number):
    """Of any number: a probe that saves once a minute comes to 2^24 after thirty years."""
    files = {}
    for copy, of, content in ((0, number, b"old"), (1, number + 1, b"new")):
        body = bytearray(of.to_bytes(4, "little") + len(content).to_bytes(4, "little") + content + bytes(4))
        crc.append(body, len(body) - 4)
        files[f"cal{copy}"] = bytes(body)
    assert records_left(files) == b"new"
    store = FlashSim(files)
    assert safe_record.Record(store, "cal").save(b"newest") == status.OK
    assert records_left(store.files) == b"newest"


def test_a_store_that_keeps_something_else_is_told_and_the_old_content_stays():
    class Forgetful(FlashSim):
        def create(self, name, data=b""):
            return super().create(name, bytes(data[:-1]) + b"?" if b"new" in data else data)

    store = Forgetful()
    assert safe_record.Record(store, "cal").save(b"old") == status.OK
    assert safe_record.Record(store, "cal").save(b"new") == status.STORE_ERROR
    assert records_left(store.files) == b"old"


def test_a_number_that_no_probe_counts_to_is_damage():
    body = bytearray((1 << 30).to_bytes(4, "little") + (3).to_bytes(4, "little") + b"odd" + bytes(4))
    crc.append(body, len(body) - 4)
    assert records_left({"cal0": bytes(body)}) is None


@pytest.mark.parametrize("length", [0, 1, 30])
def test_a_record_survives_every_cut_and_every_second_cut(length):
    old, new, newest = (bytes((k,)) * length + b"!" * k for k in (1, 2, 3))
    store = FlashSim()
    safe_record.Record(store, "cal").save(old)
    files = store.files
    store = FlashSim(files)
    safe_record.Record(store, "cal").save(new)
    cuts = pairs = 0
    for _number, _mode, left in cut_states(files, store.trace):
        cuts += 1
        found = records_left(left)
        assert found in (old, new)
        again = FlashSim(left)
        assert safe_record.Record(again, "cal").save(newest) == status.OK
        for _second, _mode2, left2 in cut_states(left, again.trace):
            pairs += 1
            assert records_left(left2) in (found, newest)
    assert cuts > 50 and pairs > cuts * cuts / 2


def test_a_calibration_survives_every_cut():
    old, new = (bytes((i * k + k) % 256 for i in range(1700)) for k in (3, 5))
    store = FlashSim()
    for content in (old, new, old):
        safe_record.Record(store, "cal").save(content)
    files = store.files
    store = FlashSim(files)
    safe_record.Record(store, "cal").save(new)
    seen = set()
    cuts = 0
    for _number, _mode, left in cut_states(files, store.trace):
        cuts += 1
        seen.add(frozenset(left.items()))
        assert records_left(left) in (old, new)
    counted(f"{cuts} cuts, {len(seen)} different stores")


def test_a_full_store_keeps_the_old_record():
    store = FlashSim(full_at=60)
    assert safe_record.Record(store, "cal").save(b"x" * 20) == status.OK
    assert safe_record.Record(store, "cal").save(b"y" * 40) == status.NO_SPACE
    assert safe_record.Record(store, "cal").load() == b"x" * 20


def test_the_simulator_itself_can_lose_and_tear():
    trace = [("create", "a", b"xy"), ("sync", "", b""), ("append", "a", b"z")]
    left = {(mode, files.get("a")) for _n, mode, files in cut_states({"a": b"old"}, trace)}
    for wanted in [
        (flash_sim.LOST, b"old"),
        (flash_sim.KEPT, b"x"),
        (flash_sim.IN_PLACE, b"xld"),
        (flash_sim.HOLES, b"\0\0"),
        (flash_sim.HOLES, b"xy\0"),
        (flash_sim.KEPT, b"xyz"),
        (flash_sim.LOST, b"xy"),
    ]:
        assert wanted in left

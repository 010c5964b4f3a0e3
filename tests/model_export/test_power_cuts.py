"""Power is cut at every operation and every byte of each write, then again while recovering.

Not only clean cuts: what had not been synced may be kept, lost, reordered or turned into zeros
(`palpate.sim.probe.flash_sim.MODES`). After each, the probe must start with a whole signed model, old or new.
"""

from __future__ import annotations

import pytest

from firmware_py import status
from palpate.sim.probe.flash_sim import FlashSim, cut_states
from tests.campaigns import counted
from tests.model_export.flashing import flash, probe_of
from tests.model_export.remembering import remember_signatures

__all__ = ["remember_signatures"]

NOW_AND_THEN, NEAR_EVERY = 97, 7
"""In every `make test`; `make test-long` makes all second cuts near the record, and most others."""


def updated(store, key, image):
    """Boot, and flash an image as the host would; the id of what is live then."""
    probe = probe_of(store, key)
    assert flash(probe, image) == status.OK
    return probe.live_id()


class Watched(FlashSim):
    """A store that notes which names were looked at."""

    def __init__(self, files):
        super().__init__(files)
        self.seen = {}

    def size(self, name):
        self.seen[name] = self.files.get(name)
        return super().size(name)

    def read(self, name, offset, n):
        self.seen[name] = self.files.get(name)
        return super().read(name, offset, n)


class Boots:
    """What a probe with this key boots to. A boot depends on nothing but the names it looks at."""

    def __init__(self, key, start=probe_of):
        self.key = key
        self.start = start
        self.known: dict[tuple, list] = {}
        self.real = 0

    def __call__(self, files):
        records = (files.get("live0"), files.get("live1"))
        for there, absent, found in self.known.setdefault(records, []):
            if there.items() <= files.items() and absent.isdisjoint(files):
                return found
        store = Watched(files)
        found = self.start(store, self.key).live_id()
        # again finds the same, and neither writes
        assert self.start(store, self.key).live_id() == found
        assert store.trace == []
        there = {name: content for name, content in store.seen.items() if content is not None}
        self.known[records].append((there, store.seen.keys() - there.keys(), found))
        self.real += 1
        return found


class Campaign:
    """Flashing one image over some start state, cut everywhere, and recovered with cuts everywhere."""

    def __init__(self, files, key, image):
        self.key = key
        self.image = image
        self.files = files
        self.boot = Boots(key)
        store = FlashSim(files)
        self.old = probe_of(store, key).live_id()
        self.new = updated(store, key, image)
        self.trace = store.trace
        self.cuts = self.pairs = 0
        self.found = set()
        self.second: dict[tuple, int] = {}

    def run(self, recover_every, near_every):
        """All single cuts; from every n-th state they leave, and more near the record, all second cuts."""
        recovered = set()
        for number, _mode, files in cut_states(self.files, self.trace):
            self.cuts += 1
            found = self.boot(files)
            assert found in (self.old, self.new)
            self.found.add(found)
            near_record = self.trace[min(number, len(self.trace) - 1)][1].startswith("live")
            if self.cuts % (near_every if near_record else recover_every) == 0:
                state = frozenset(files.items())
                if state not in recovered:
                    recovered.add(state)
                    self.recover(files, found)
        return self

    def recover(self, files, before):
        """Flash again from what the first cut left, and cut that everywhere, too.

        The second flash begins by emptying its slot, so two states that differ only there pass through the
        same stores from then on; those are tried once.
        """
        store = FlashSim(files)
        assert updated(store, self.key, self.image) == self.new
        assert store.trace[0][0] == "create" and store.trace[0][2] == b""
        target = store.trace[0][1]
        rest = frozenset((k, v) for k, v in files.items() if k != target)
        kind = (rest, tuple(store.trace))
        if kind not in self.second:
            cuts = 0
            for _number, _mode, again in cut_states(files, store.trace):
                cuts += 1
                assert self.boot(again) in (before, self.new)
            self.second[kind] = cuts
        self.pairs += self.second[kind]


def campaign(files, key, image, recover_every):
    done = Campaign(files, key, image).run(recover_every, 1 if recover_every < NOW_AND_THEN else NEAR_EVERY)
    counted(
        f"{len(done.trace)} operations, {done.cuts} cuts, {done.pairs} pairs of cuts, "
        f"{done.boot.real} boots that looked at something different"
    )
    assert done.cuts > 10000 and done.pairs > done.cuts
    return done


def once_flashed(key, *images):
    store = FlashSim()
    for image in images:
        updated(store, key, image)
    return store.files


@pytest.mark.parametrize("recover_every", [NOW_AND_THEN, pytest.param(1, marks=pytest.mark.long)])
def test_an_update_survives_every_cut_and_every_second_cut(signed, public_key, recover_every):
    start_files = once_flashed(public_key, signed[1])
    done = campaign(start_files, public_key, signed[2], recover_every)
    assert any(done.old) and done.found == {done.old, done.new}


@pytest.mark.parametrize("recover_every", [997, pytest.param(3, marks=pytest.mark.long)])
def test_a_later_update_back_into_the_first_slot_survives_too(signed, public_key, recover_every):
    start_files = once_flashed(public_key, signed[1], signed[2])
    done = campaign(start_files, public_key, signed[3], recover_every)
    assert any(done.old) and done.found == {done.old, done.new}


def test_the_first_model_of_all_is_there_whole_or_not_at_all(signed, public_key):
    done = campaign({}, public_key, signed[1], 997)
    assert done.old == bytes(8) and done.found == {done.old, done.new}


def test_an_aborted_update_leaves_the_old_model_at_every_cut(signed, public_key):
    files = once_flashed(public_key, signed[1])
    store = FlashSim(files)
    probe = probe_of(store, public_key)
    old = probe.live_id()
    probe.begin(len(signed[2]))
    probe.write(0, signed[2][:1000])
    probe.abort()
    boot = Boots(public_key)
    for _number, _mode, left in cut_states(files, store.trace):
        assert boot(left) == old

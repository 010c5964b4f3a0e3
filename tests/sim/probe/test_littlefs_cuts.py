"""Power cuts in the middle of the flash chip's commands while a model is flashed, under the real littlefs."""

import numpy as np
import pytest

from firmware_py import status
from tests.host.conftest import bench, images, specs
from tests.model_export import flashing
from tests.sim.probe import board_bench
from tests.sim.probe.flash_cuts import Change, cut_short, probe_on, states

flash_image = pytest.importorskip("palpate.sim.probe.rp2040.flash")

__all__ = ["bench", "images", "specs"]
CUTS = 200
FLASHED_AGAIN = 40  # every so many cuts
MOST_ERASED = 20


@pytest.fixture
def flashed(images, public_key, tmp_path):
    """Blocks with the first model live, and what flashing the second one changes in them."""
    before = flash_image.image(board_bench.kept_files(tmp_path, images[0]))
    probe, code = probe_on(before, public_key)
    assert code == status.OK
    began = len(probe.store.device.changes)
    assert flashing.flash(probe, images[1]) == status.OK
    return before, probe.store.device.changes, began


def test_whatever_is_cut_a_whole_signed_model_is_live_old_or_new(flashed, images, public_key):
    """And the flash can be done again. Each command is cut as often as it takes for so many cuts in all."""
    before, changes, began = flashed
    random = np.random.default_rng(12)
    commands = range(began, len(changes))
    times = -(-CUTS // len(commands))
    live = []
    for k, chip in states(before, changes, set(commands)):
        for _ in range(times):
            probe, code = probe_on(cut_short(chip, changes[k], random), public_key)
            assert code == status.OK, (k, changes[k])
            live.append((k, images.index(probe.read(0, 1 << 16))))
            if len(live) % FLASHED_AGAIN == 0:
                assert flashing.flash(probe, images[1]) == status.OK
                assert probe.read(0, 1 << 16) == images[1]
    erased = sum(changes[k].data is None for k, _ in live)
    print(f"{len(live)} cuts, {erased} while erasing, each of {len(commands)} commands {times} times")
    assert len(live) >= CUTS
    assert {which for _, which in live} == {0, 1}


def test_flashing_erases_a_block_for_each_page_kept_not_for_each_piece_of_the_wire(flashed, images):
    """Every piece of 48 bytes had littlefs erase a block: a real chip took 14 s for the bundled model."""
    _, changes, began = flashed
    erased = sum(change.data is None for change in changes[began:])
    print(f"{len(images[1])} bytes: {erased} blocks erased, {len(changes) - began} commands in all")
    assert erased < MOST_ERASED


def test_a_program_that_is_cut_short_clears_bits_only_and_nothing_outside_a_command_changes():
    random = np.random.default_rng(1)
    chip = random.bytes(8192)
    old = np.frombuffer(chip, np.uint8)
    for change, allowed in (
        (Change(4096, None, 4096), lambda new: np.full(len(new), True)),
        (Change(256, random.bytes(256), 256), lambda new: (new & old) == new),
    ):
        new = np.frombuffer(cut_short(chip, change, random), np.uint8)
        assert allowed(new).all()
        outside = np.r_[0 : change.at, change.at + change.size : 8192]
        assert np.array_equal(new[outside], old[outside])
        assert not np.array_equal(new, old)

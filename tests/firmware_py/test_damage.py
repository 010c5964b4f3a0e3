"""What rots in the settings' record is repaired, or told; so is what a power cut has left of it."""

import pytest

from firmware_py import messages, safe_record, status
from firmware_py.estimator import Estimator
from firmware_py.store import FileStore
from palpate.sim.probe.flash_sim import FlashSim, cut_states
from palpate.sim.probe.virtual import VirtualBoard
from tests.campaigns import counted
from tests.firmware_py.streaming import STROKE
from tests.firmware_py.talk import Bench
from tests.model_export.flashing import flipped

RATE = 80_000
COPIES = ("set0", "set1")


def started(files, frames=b"", estimator=None):
    """A probe that starts with these files."""
    board = VirtualBoard(frames)
    board.settings_record = safe_record.Record(FlashSim(files), "set")
    return Bench(board, estimator)


def files_of(bench):
    return bench.probe.board.settings_record.store.files


def rate(bench):
    return bench.ask("get_setting", (0,)).fields["value"]


def damage(bench):
    return bench.ask("identify", (7,)).fields["damage"]


@pytest.fixture(scope="module")
def files():
    """What a probe keeps whose frame rate was set."""
    bench = started({})
    assert bench.ask("set_setting", (0, RATE)).code == status.OK
    assert damage(bench) == 0
    return files_of(bench)


@pytest.mark.parametrize("step", [7, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", COPIES)
def test_a_flip_in_a_copy_is_repaired_and_told_once(files, name, step):
    """Nobody was told, the copy was never written again, and a flip in the other one lost the settings."""
    for bit in range(0, 8 * len(files[name]), step):
        bench = started(flipped(files, name, bit))
        assert rate(bench) == RATE and damage(bench) == messages.DAMAGE_REPAIRED
        again = started(files_of(bench))
        assert rate(again) == RATE and damage(again) == 0
    counted(f"{-(-8 * len(files[name]) // step)} flips")


def test_settings_lost_in_both_copies_are_told_and_the_defaults_stand_in(files):
    """The probe went back to its defaults, and said nothing."""
    lost = flipped(flipped(files, "set0", 99), "set1", 180)
    bench = started(lost)
    assert rate(bench) == messages.SETTINGS[0][5] and damage(bench) == messages.DAMAGED_SETTINGS
    boot = next(m for m in bench.heard if m.name == "boot")
    assert boot.fields["status"] == status.ROTTEN
    # told at every start, until somebody sets one, be it to what it is
    again = started(files_of(bench))
    assert damage(again) == messages.DAMAGED_SETTINGS
    assert again.ask("set_setting", (0, messages.SETTINGS[0][5])).code == status.OK
    assert damage(again) == messages.DAMAGED_SETTINGS  # what this start has found stays true
    assert damage(started(files_of(again))) == 0


def test_an_estimate_says_what_it_may_rest_on(files, tmp_path):
    lost = flipped(flipped(files, "set0", 99), "set1", 180)
    bench = started(lost, STROKE, Estimator(FileStore(str(tmp_path))))
    bench.ask("stream_start", (messages.CONTENT_STROKES, 1, 1, 0))
    bench.run(4_000_000)
    (estimate,) = [m for m in bench.heard if m.name == "estimate"][:1]
    assert estimate.fields["damage"] == messages.DAMAGED_SETTINGS


def test_the_worst_that_was_found_is_the_boot_events_status(files, tmp_path):
    """A calibration that could be repaired does not hide settings that could not."""
    store = FileStore(str(tmp_path))
    estimator = Estimator(store)
    estimator._record.save(estimator.calibration.to_bytes())
    (tmp_path / "cal1").write_bytes(b"\1" * 100)
    bench = started(flipped(flipped(files, "set0", 99), "set1", 180), b"", Estimator(store))
    assert damage(bench) == messages.DAMAGED_SETTINGS | messages.DAMAGE_REPAIRED
    assert next(m for m in bench.heard if m.name == "boot").fields["status"] == status.ROTTEN


# -- a record whose saving was cut short


def saved(content, files=None):
    """A store in which this was saved, with its trace."""
    store = FlashSim(files)
    assert safe_record.Record(store, "set").save(content) == status.OK
    return store


def test_a_first_save_cut_at_any_byte_is_whole_or_was_never_there_and_is_no_rot():
    """Cut in the second copy, the first is whole: it is repaired, and whole twice after one start."""
    content = bytes(range(40))
    seen = set()
    for _number, _mode, left in cut_states({}, saved(content).trace):
        record = safe_record.Record(FlashSim(left), "set")
        kept = record.restore()
        assert kept in (None, content)
        assert record.state in ((status.OK,) if kept is None else (status.OK, status.REPAIRED))
        seen.add((record.state, kept is None))
        if kept:
            assert {record.store.files[name] for name in COPIES} == {record.store.files["set0"]}
            again = safe_record.Record(FlashSim(record.store.files), "set")
            assert again.load() == content and again.state == status.OK
    assert len(seen) == 3  # never there; whole; whole with a torn second copy


def test_after_any_cut_of_a_later_save_and_one_start_any_flip_is_repaired():
    old, new = b"before" * 5, b"after!" * 5
    before = saved(old).files
    for k, (_number, _mode, left) in enumerate(cut_states(before, saved(new, before).trace)):
        record = safe_record.Record(FlashSim(left), "set")
        kept = record.restore()
        assert kept in (old, new) and record.state != status.ROTTEN
        name = COPIES[k % 2]
        bit = 31 * k % (8 * len(record.store.files[name]))
        rotten = safe_record.Record(FlashSim(flipped(record.store.files, name, bit)), "set")
        assert rotten.restore() == kept and rotten.state == status.REPAIRED

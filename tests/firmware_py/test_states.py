"""The states of docs/protocol.md: idle, streaming, measuring, and what leads from one to another."""

import pytest

from firmware_py import messages, status
from firmware_py.estimator import Estimator
from firmware_py.flash import Flash
from firmware_py.store import FileStore
from palpate.model_export.exporter import export
from tests import reference_model
from tests.firmware_py.talk import Bench, command, send_model

ZERO = (messages.CALIBRATE_ZERO, 20, 0)
BOTH = (messages.CONTENT_FRAMES | messages.CONTENT_STROKES, 1, 0, 0)


@pytest.fixture
def bench(tmp_path):
    return Bench.measuring(tmp_path)


def running(bench):
    """The number of the stream that runs, 0: none."""
    return bench.ask("identify", (7,)).fields["stream"]


def test_a_stream_is_left_by_its_stop_and_by_another_stream(bench):
    assert running(bench) == 0
    first = bench.ask("stream_start", BOTH).fields["stream"]
    assert running(bench) == first > 0
    second = bench.ask("stream_start", BOTH).fields["stream"]
    assert running(bench) == second != first
    assert bench.ask("stream_stop").fields["stream"] == second
    assert running(bench) == 0 and bench.ask("stream_stop").fields["stream"] == 0


def test_while_it_streams_it_does_not_measure(bench):
    stream = bench.ask("stream_start", BOTH).fields["stream"]
    assert bench.ask("calibrate", ZERO).code == status.BUSY
    assert running(bench) == stream


def test_while_it_measures_it_begins_nothing_else(bench):
    bench.send(command("calibrate", 77, ZERO))
    assert bench.ask("stream_start", BOTH).code == status.BUSY
    assert bench.ask("calibrate", ZERO).code == status.BUSY
    assert bench.send(command("calibrate", 77, ZERO)) == []  # it is at it: the answer comes when it is done
    bench.run(1_000_000)
    assert [m.code for m in bench.heard if m.number == 77] == [status.OK]
    assert bench.ask("stream_start", BOTH).code == status.OK


def test_a_new_host_is_not_answered_what_another_one_had_asked(bench):
    bench.send(command("calibrate", 77, ZERO))
    assert running(bench) == 0
    bench.run(1_000_000)
    assert not [m for m in bench.heard if m.number == 77]
    assert bench.ask("stream_start", BOTH).code == status.OK


def test_a_model_is_neither_verified_nor_confirmed_while_a_press_refers_to_the_live_one(
    real_key_dir, public_key, tmp_path
):
    """The press went on with the tables of a model that had been set aside, and its result was lost."""
    store = FileStore(str(tmp_path))
    bench = Bench(estimator=Estimator(store, Flash(store, public_key)))
    image, _ = export(reference_model.model(), real_key_dir)
    name, live = send_model(bench.ask, image), image[40:48]
    assert bench.ask("flash_verify", (name,)).code == status.OK
    assert bench.ask("flash_confirm", (live,)).code == status.OK
    send_model(bench.ask, image)  # the same once more, so that there is something to verify
    taking = command("reference", 77, (messages.REFERENCE_TAKE,))
    assert bench.send(taking) == []
    assert bench.ask("flash_verify", (name,)).code == status.BUSY
    assert bench.ask("flash_confirm", (live,)).code == status.BUSY
    assert bench.send(taking) == [], "it is at it still"
    bench.ask("stream_stop")
    assert bench.ask("flash_verify", (name,)).code == status.OK
    assert bench.ask("flash_confirm", (live,)).code == status.OK

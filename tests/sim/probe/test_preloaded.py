"""A model that an emulated probe has from the start."""

import pytest

from firmware_py.store import FileStore
from palpate.link import emulator_model as emulator
from palpate.model_export.image_builder import inspect
from palpate.sim.probe.emulated import EmulatedProbe
from palpate.sim.probe.preloaded import NotTaken, preload
from tests.host.conftest import bench, images, specs
from tests.host.probes import connect

__all__ = ["bench", "images", "specs"]


def test_an_emulated_probe_may_begin_with_a_model():
    image = emulator.image()
    with (
        EmulatedProbe("cpython", public_key=emulator.public_key(), model=image) as probe,
        connect(probe) as client,
    ):
        assert client.identity.model_id == inspect(image).model_id


def test_a_probe_that_has_a_model_keeps_it(images, public_key, tmp_path):
    store = FileStore(str(tmp_path))
    preload(store, public_key, images[0])
    kept = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    preload(store, public_key, images[1])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == kept


def test_what_another_key_signed_is_refused_and_leaves_nothing(public_key, tmp_path):
    with pytest.raises(NotTaken, match="cannot begin with this model"):
        preload(FileStore(str(tmp_path)), public_key, emulator.image())
    assert list(tmp_path.iterdir()) == []


def test_the_emulated_board_takes_it_into_its_flash_chip(images, public_key, tmp_path):
    from palpate.sim.probe.rp2040 import __main__ as board
    from palpate.sim.probe.rp2040 import flash

    preload(FileStore(str(tmp_path)), public_key, images[0])
    files = flash.read(board.blocks(tmp_path, public_key))
    assert files["model0"] == images[0]
    assert files["key.pub"] == public_key
    assert {"live0", "live1", "main.py"} <= set(files)

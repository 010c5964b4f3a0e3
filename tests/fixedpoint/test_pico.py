"""docs/howto/your-own-regression.md on a bare RP2040 (emulated) under MicroPython's own port."""

from __future__ import annotations

import shlex
from array import array
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import skops.io

from firmware_py import evaluator, slots, status
from firmware_py.store import FileStore
from palpate.cli import main
from palpate.fixedpoint import from_sklearn
from palpate.model_export.image_builder import inspect
from palpate.sim.probe.flash_sim import FlashSim, cut_states
from tests.campaigns import counted
from tests.docs.blocks import DOCS, blocks_of
from tests.model_export.flashing import flash as flashed
from tests.model_export.remembering import remember_signatures
from tests.model_export.test_power_cuts import Boots
from tests.sim.probe.board_bench import uf2
from tests.sim.probe.flash_cuts import apply, cut_short, of_command

__all__ = ["remember_signatures"]

PAGE = DOCS / "howto" / "your-own-regression.md"
READINGS = np.array([[1234, 999]])
MOST_LINES = 40
DEVICE = "gap meter"


class Pico:
    """A bare board with two voltages on its converter's pins, and what it prints."""

    def __init__(self, blocks: bytes) -> None:
        from palpate.sim.probe.rp2040.chip import Chip

        path = uf2()
        assert path
        self.chip = Chip(path, blocks)
        for channel, counts in enumerate(READINGS[0]):
            self.chip.mcu.adc.channel_values[channel] = int(counts)
        self._heard = b""
        self.chip.run(lambda: self.chip.connected)

    def listened(self, words: bytes) -> bool:
        """Whether it has said this by now."""
        self._heard += self.chip.take()
        return words in self._heard

    def hears(self, words: bytes) -> None:
        """Run until it has said this; what it says from there on is heard next."""
        self.chip.run(lambda: self.listened(words), 60e6)
        self._heard = self._heard.partition(words)[2]

    def prediction(self) -> list[str]:
        """The words of the next whole line."""
        self.hears(b"\n")
        self.chip.run(lambda: self.listened(b"\n"))
        return self._heard.partition(b"\n")[0].decode().split()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What the page's blocks make, with its programs for the board."""
    place = tmp_path_factory.mktemp("pico")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        for block in blocks_of(PAGE):
            if block.runs_as == "python":
                exec(compile(block.text, block.where, "exec"), {})
            elif block.runs_as == "sh":
                for line in block.text.splitlines():
                    assert main(shlex.split(line)[1:]) == 0
            elif block.title:
                Path(block.title).write_text(block.text)
    return place


@pytest.fixture(scope="module")
def board(folder, tmp_path_factory):
    """The flash of a board with the page's main.py and the evaluator, whose slots hold the first model."""
    from palpate.sim.probe.rp2040 import flash

    root, kept = folder / "out" / "board", tmp_path_factory.mktemp("kept")
    key = (root / "key.pub").read_bytes()
    assert flashed(slots_of(FileStore(str(kept)), key), (folder / "model.palp").read_bytes()) == status.OK
    files = {p.relative_to(at).as_posix(): p.read_bytes() for at in (root, kept) for p in at.rglob("*")
             if p.is_file()}  # fmt: skip
    return flash.image(files | {"main.py": (folder / "main.py").read_bytes()})


def module_says(folder):
    """The integers that the compiler says the module gives."""
    table = pd.read_csv(folder / "table.csv")[["hall", "thermistor"]]
    program = from_sklearn(skops.io.load(folder / "model.skops", trusted=[]), table, units=("mm",))
    return [str(v) for v in program.predict(READINGS)[0]]


def said(folder, name):
    """What the firmware's evaluator makes of the readings here: the line that the board is to print."""
    public = (folder / "out" / "key" / "public.key").read_bytes()
    info = inspect((folder / f"{name}.palp").read_bytes(), public, DEVICE)
    out = array("i", [0] * evaluator.OUT_SIZE)
    assert info.model.evaluate(array("i", READINGS[0].tolist()), out) == status.OK
    return [*map(str, out[:3]), "like" if out[evaluator.FLAGS] & evaluator.IN_DOMAIN else "unlike"]


def test_the_user_s_code_is_forty_lines(folder):
    lines = (folder / "main.py").read_text().splitlines()
    assert len([line for line in lines if line.strip()]) <= MOST_LINES


@pytest.mark.board
def test_a_bare_pico_says_what_the_compiler_says(folder):
    from palpate.sim.probe.rp2040 import flash

    files = {"main.py": folder / "plain.py", "model.mpy": folder / "model.mpy"}
    blocks = flash.image({name: path.read_bytes() for name, path in files.items()})
    assert Pico(blocks).prediction() == module_says(folder)


@pytest.mark.board
def test_a_bare_pico_runs_the_probe_s_evaluator_and_takes_another_model_over_serial(folder, board):
    pico = Pico(board)
    assert pico.prediction() == said(folder, "model")
    began_us = pico.chip.us
    pico.chip.send((folder / "better.txt").read_bytes())
    pico.hears(b"put: ok")
    print(f"sent, verified and tried in {(pico.chip.us - began_us) / 1e6:.1f} s of device time")
    assert pico.prediction() == said(folder, "better") != said(folder, "model")


@pytest.mark.long
@pytest.mark.board
def test_a_board_without_a_model_refuses_a_damaged_one_and_starts_with_the_next(folder, board):
    from palpate.sim.probe.rp2040 import flash

    root = folder / "out" / "board"
    files = {p.relative_to(root).as_posix(): p.read_bytes() for p in root.rglob("*") if p.is_file()}
    pico = Pico(flash.image(files | {"main.py": (folder / "main.py").read_bytes()}))
    pico.chip.run_us(1e6)
    update = (folder / "model.txt").read_bytes()
    lines = update.splitlines(keepends=True)
    lines[20] = lines[21]
    pico.chip.send(b"".join(lines))
    pico.hears(f"put: {status.TEXT[status.BAD_SIGNATURE]}".encode())
    pico.chip.send(update)
    pico.hears(b"put: ok")
    assert Pico(pico.chip.files()).prediction() == said(folder, "model")


def slots_of(store, key):
    """The slots of the page's main.py, started."""
    models = slots.Slots(store, key, 1, len(READINGS[0]), DEVICE.encode())
    models.boot()
    return models


def test_power_cut_at_any_byte_of_an_update_leaves_a_working_model(folder):
    """At every operation of the store and every byte of each, with what is not synced kept, lost or torn."""
    key = (folder / "out/key/public.key").read_bytes()
    images = [(folder / f"{name}.palp").read_bytes() for name in ("model", "better")]
    store = FlashSim()
    assert flashed(slots_of(store, key), images[0]) == status.OK
    before = dict(store.files)
    again = FlashSim(before)
    assert flashed(slots_of(again, key), images[1]) == status.OK
    boots, cuts, found = Boots(key, slots_of), 0, set()
    for _number, _mode, left in cut_states(before, again.trace):
        cuts += 1
        found.add(boots(left))
    counted(f"{cuts} cuts, {boots.real} starts that looked at something different")
    assert cuts > len(images[1]) and found == {image[40:48] for image in images}


@pytest.mark.long
@pytest.mark.board
def test_power_cut_while_the_flash_chip_writes_leaves_a_working_model(folder, board):
    """Between commands to the chip, and within them; then the board starts from what the chip holds."""
    pico = Pico(board)
    pico.hears(b"\n")
    changes = []
    pico.chip.before_flash = lambda command: changes.append(of_command(command))
    pico.chip.send((folder / "better.txt").read_bytes())
    pico.hears(b"put: ok")
    random = np.random.default_rng(1)
    found = set()
    for number in sorted(random.choice(len(changes), 5, replace=False).tolist()):
        chip = bytearray(board)
        for change in changes[:number]:
            apply(chip, change)
        found.add(tuple(Pico(cut_short(bytes(chip), changes[number], random)).prediction()))
    assert found <= {tuple(said(folder, "model")), tuple(said(folder, "better"))}

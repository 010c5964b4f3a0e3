"""docs/howto/your-own-regression.md on a bare RP2040 (emulated) under MicroPython's own port."""

from __future__ import annotations

import binascii
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import skops.io

import firmware_py
from palpate.cli import main
from palpate.fixedpoint import from_sklearn
from tests.docs.blocks import DOCS, blocks_of
from tests.sim.probe.board_bench import uf2

PAGE = DOCS / "howto" / "your-own-regression.md"
READINGS = np.array([[1234, 999]])
MOST_LINES = 40


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
        self.chip.run(lambda: self.listened(words))
        self._heard = self._heard.partition(words)[2]

    def prediction(self) -> list[int]:
        """The next whole line of numbers."""
        self.hears(b"\n")
        self.chip.run(lambda: self.listened(b"\n"))
        return [int(word) for word in self._heard.partition(b"\n")[0].split()]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What the page's blocks make, with its main.py."""
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
        plain = Path("main.py").read_text()
        asking = plain.replace("    if got != crc:\n", Path("in take").read_text())
        before, take, after = asking.partition("def take(")
        assert asking != plain and take
        Path("asking.py").write_text(before + Path("signed").read_text() + "\n" + take + after)
    return place


@pytest.fixture(scope="module")
def blocks(folder):
    """The board's flash, as the page fills it."""
    from palpate.sim.probe.rp2040 import flash

    return flash.image({name: (folder / name).read_bytes() for name in ("main.py", "model.mpy")})


def put(data: bytes) -> bytes:
    """The lines that bring a model, as the page makes them."""
    lines = [f"put {len(data)} {binascii.crc32(data)}\n".encode()]
    lines += [binascii.b2a_base64(data[k : k + 90]) for k in range(0, len(data), 90)]
    return b"".join(lines)


def integers(folder, name):
    """What the compiler says the model of this file gives."""
    table = pd.read_csv(folder / "table.csv")[["hall", "thermistor"]]
    program = from_sklearn(skops.io.load(folder / f"{name}.skops", trusted=[]), table, units=("mm",))
    return program.predict(READINGS)[0].tolist()


def test_the_user_s_code_is_forty_lines(folder):
    lines = (folder / "main.py").read_text().splitlines()
    assert len([line for line in lines if line.strip()]) <= MOST_LINES


@pytest.mark.board
def test_a_bare_pico_says_what_the_compiler_says(folder, blocks):
    assert Pico(blocks).prediction() == integers(folder, "model")


@pytest.mark.board
def test_another_model_comes_over_serial_and_survives_the_plug(folder, blocks):
    update = (folder / "update.txt").read_bytes()
    board = Pico(blocks)
    board.hears(b"\n")
    board.chip.send(update)
    board.hears(b"live: model_b")
    assert board.prediction() == integers(folder, "better") != integers(folder, "model")
    assert Pico(board.chip.files()).prediction() == integers(folder, "better")


@pytest.mark.board
def test_half_a_model_and_a_damaged_one_leave_the_old_one(folder, blocks):
    update = (folder / "update.txt").read_bytes()
    damaged = update.replace(b" ", b" 1", 2).replace(b"put 1", b"put ", 1)
    board = Pico(blocks)
    board.hears(b"\n")
    board.chip.send(damaged)
    board.hears(b"damaged, the old model stays")
    assert board.prediction() == integers(folder, "model")
    board.chip.send(update[: len(update) // 2])
    board.chip.run_us(200_000)
    assert Pico(board.chip.files()).prediction() == integers(folder, "model")


@pytest.mark.long
@pytest.mark.board
def test_a_board_that_asks_for_signatures_takes_no_other_model(folder):
    from palpate.sim.probe.rp2040 import flash

    firmware = Path(firmware_py.__file__).parent
    kept = {f"firmware_py/{name}": (firmware / name).read_bytes() for name in ("slh_dsa.py", "status.py")}
    kept |= {"public.key": (folder / "out" / "key" / "public.key").read_bytes()}
    kept |= {"main.py": (folder / "asking.py").read_bytes(), "model.mpy": (folder / "model.mpy").read_bytes()}
    board = Pico(flash.image(kept))
    board.hears(b"\n")
    signed = (folder / "signed.mpy").read_bytes()
    for wrong in ((folder / "better.mpy").read_bytes(), signed[:100] + b"\x01" + signed[101:]):
        board.chip.send(put(wrong))
        board.hears(b"damaged, the old model stays")
        assert board.prediction() == integers(folder, "model")
    began_us = board.chip.us
    board.chip.send(put(signed))
    board.hears(b"live: model_b")
    print(f"sent and verified in {(board.chip.us - began_us) / 1e6:.1f} s of device time")
    assert board.prediction() == integers(folder, "better")

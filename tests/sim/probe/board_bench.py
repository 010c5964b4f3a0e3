"""A reference board on the test's bench: the emulated chip, its circuit, and a plain host at its USB port."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from firmware_py import calib, live_model, messages, safe_record, status
from firmware_py.store import FileStore
from palpate import models
from palpate.errors import PalpateError
from palpate.model_export.exporter import export
from palpate.sim.probe import source
from palpate.sim.probe.circuit import Matrix
from palpate.sim.probe.hand import Hand, Moment, moments
from palpate.sim.probe.rp2040 import interpreter
from tests.firmware_py.talk import Ears, Message, command, send_model

PROMPT = b"\r\n>>> "


@functools.cache
def uf2() -> Path | None:
    """MicroPython's port, or None where there is none: then the board's promises are not tried."""
    try:
        return interpreter.find()
    except PalpateError:
        return None


@functools.cache
def firmware() -> dict[str, bytes]:
    """The board's files, compiled once."""
    from palpate.sim.probe.rp2040.board_files import board_files

    return board_files()


LOADER = "loader.py"


def at_the_prompt(pack: bytes, **words) -> Board:
    """A board at MicroPython's prompt; `exec(open("loader.py").read())` puts the pack's modules within reach.

    Parameters: the modules, and those of Board.
    """
    from palpate.sim.probe.rp2040.board_files import MAIN, PACK
    from palpate.sim.probe.rp2040.main_text import main_text

    start, _, _ = main_text(False, messages.TYPE["log"]).partition("\ntry:\n")
    loader = start.replace("machine.WDT(", "dict(") + (
        "\nos.mount(Pack(PACK), '/f')\nsys.path.insert(0, '/f')\n"
    )
    files = {MAIN: b"", LOADER: loader.encode(), PACK: pack, **words.pop("files", {})}
    board = Board(files, **words)
    board.chip.run(lambda: board.chip.connected)
    return board


@functools.cache
def bundled(name: str, key_dir: Path) -> bytes:
    """A model that comes with Palpate, signed; none is newer than another, so each may follow each."""
    return export(models.load(name), key_dir, counter=1)[0]


def kept_files(
    folder: Path, model: bytes | None = None, calibration: calib.Calibration | None = None
) -> dict[str, bytes]:
    """The files of a probe on which this signed model is live and this calibration kept."""
    store = FileStore(str(folder))
    if calibration:
        assert safe_record.Record(store, "cal").save(calibration.to_bytes()) == 0
    if model:
        store.create(live_model.NAMES[0], model)
        record = bytearray(live_model.RECORD_BYTES)
        record[1:5] = model[12:16]
        record[5:13] = model[40:48]
        assert safe_record.Record(store, "live").save(record) == 0
    return {path.name: path.read_bytes() for path in folder.iterdir()}


class Board:
    """A board with its power on.

    Parameters
    files: beside the firmware; one named main.py takes its place
    way: what the hand does once a stream begins
    cells, displacement: counts under a hand that does nothing
    blocks: the flash chip's file system, instead of files
    """

    def __init__(
        self,
        files: Mapping[str, bytes] | None = None,
        way: Sequence[Moment] = (),
        cells: np.ndarray | None = None,
        displacement: int = 0,
        blocks: bytes | None = None,
        settling_us: float = 1.0,
    ) -> None:
        from palpate.sim.probe.rp2040 import flash
        from palpate.sim.probe.rp2040.chip import Chip
        from palpate.sim.probe.rp2040.wiring import ReferenceCircuit

        path = uf2()
        assert path
        self.matrix = Matrix(settling_us=settling_us)
        self.hand = Hand(self.matrix, way)
        if cells is not None:
            self.matrix.cells, self.matrix.displacement_counts = cells.reshape(-1), displacement
        if blocks is None:
            blocks = flash.image({**firmware(), **(files or {})})
        self.circuit = ReferenceCircuit(self.matrix, self.hand)
        self.chip = Chip(path, blocks, [self.circuit])
        self.ears = Ears()
        self.heard: list[Message] = []
        self._number = 100
        self._last = b""  # of what it said, for whoever waits in vain

    def stroke(
        self, strokes: Sequence[source.FramedStroke], folder: Path, lifted: int = source.LIFTED_AS_BY_HAND
    ) -> None:
        """From the next stream on a hand leads the board over these strokes, one after the other."""
        way = source.write_source(folder / "way", strokes, lifted).read_bytes()
        self.hand = self.circuit.hand = Hand(self.matrix, moments(way))

    def until(self, reached: Callable[[], bool], limit_us: float = 5e6) -> None:
        """Run until something is so; not on after the firmware has ended."""
        from palpate.sim.probe.rp2040.chip import Dead

        def listened() -> bool:
            data = self.chip.take()
            self._last = (self._last + data)[-500:]
            self.heard += self.ears.hear(data)
            if self._last.endswith(PROMPT):
                raise Dead(f"the firmware has ended at MicroPython's prompt: {self._last!r}")
            return reached()

        try:
            self.chip.run(listened, limit_us)
        except PalpateError as dead:
            raise type(dead)(f"{dead}; before that: {self._last!r}") from None

    def until_up(self, limit_us: float = 10e6) -> Board:
        """Run until it has said that it has started."""
        self.until(lambda: bool(self.named("boot")), limit_us)
        return self

    def run_us(self, us: float) -> None:
        """Run for so long."""
        end = self.chip.us + us
        self.until(lambda: self.chip.us >= end, 2 * us + 1e6)

    def named(self, name: str) -> list[dict]:
        """The fields of every message of that name."""
        return [message.fields for message in self.heard if message.name == name]

    def logs(self) -> list[str]:
        """What the probe has said in words."""
        return [bytes(fields["tail"]).decode() for fields in self.named("log")]

    def send(self, name: str, values=(), tail=b"") -> int:
        """A command leaves; its number."""
        self._number += 1
        self.chip.send(command(name, self._number, values, tail))
        return self._number

    def ask(self, name: str, values=(), tail=b"", limit_us: float = 5e6) -> Message:
        """A command and its answer."""
        number = self.send(name, values, tail)
        answers: list[Message] = []

        def answered() -> bool:
            answers.extend(m for m in self.heard if m.number == number and m.kind & messages.ANSWER)
            return bool(answers)

        self.until(answered, limit_us)
        return answers[0]

    def flash(self, image: bytes) -> None:
        """Send a signed model, piece by piece, and have it verified and made live."""
        name = send_model(self.ask, image)
        made_ready = self.ask("flash_verify", (name,), limit_us=10e6).fields["model_id"]
        assert self.ask("flash_confirm", (made_ready,), limit_us=10e6).code == status.OK

    def counters(self) -> dict[str, int]:
        """The probe's own counters."""
        return dict(zip(messages.COUNTERS, self.ask("statistics").fields["tail"], strict=True))

"""The emulated reference board as a process: its USB port is standard input and output.

python -m palpate.sim.probe.rp2040 CONFIG; `palpate.sim.probe.emulated` writes the configuration and starts
it.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

from palpate.sim.probe.circuit import Matrix
from palpate.sim.probe.hand import Hand, moments
from palpate.sim.probe.rp2040 import flash
from palpate.sim.probe.rp2040.board_files import board_files
from palpate.sim.probe.rp2040.chip import Chip
from palpate.sim.probe.rp2040.wiring import ReferenceCircuit

BLOCKS = "flash.bin"
_RECORDS = ("cal", "key", "live", "model", "set")
"""How the names of what the firmware keeps begin; `key` is a successor of the public key."""
_KEEP_S = 0.5
_MOST_HELD = 1 << 20


def blocks(store: Path, key: bytes | None) -> bytes:
    """The flash chip's file system: as it was kept in the store, or a new one with the firmware on it.

    What lies in the store as files, as other emulated probes have it (calibration, model), is taken over.
    """
    kept = store / BLOCKS
    files = flash.read(kept.read_bytes()) if kept.exists() else {}
    for path in store.iterdir():
        if path.name.startswith(_RECORDS) and path.name not in files:
            files[path.name] = path.read_bytes()
    return flash.image(files | board_files(key))


class Port:
    """The chip's USB port on two file descriptors that never wait."""

    def __init__(self, incoming: int, outgoing: int) -> None:
        self._in, self._out = incoming, outgoing
        os.set_blocking(incoming, False)
        os.set_blocking(outgoing, False)
        self._held = bytearray()

    def carry(self, chip: Chip) -> None:
        """Bytes to and from the chip. Raises EOFError when nobody is there any more."""
        try:
            data = os.read(self._in, 4096)
            if not data:
                raise EOFError
            chip.send(data)
        except BlockingIOError:
            pass
        self._held += chip.take()
        del self._held[: max(0, len(self._held) - _MOST_HELD)]
        try:
            while self._held:
                del self._held[: os.write(self._out, self._held)]
        except BlockingIOError:
            pass


def run(config: dict[str, Any]) -> None:
    """Power on, until the other end of the port is closed or the process is ended."""
    store = Path(config["store"])
    key = config["public_key"]
    matrix = Matrix()
    hand = Hand(matrix, moments(Path(config["source"]).read_bytes()), repeat=config["repeat"])
    chip = Chip(
        Path(config["uf2"]),
        blocks(store, bytes(key) if key else None),
        [ReferenceCircuit(matrix, hand)],
        bytes(config["serial"]),
    )
    port = Port(sys.stdin.fileno(), sys.stdout.fileno())
    kept, kept_at = 0, 0.0
    listens = config["listens"]
    orders = b""
    began = time.monotonic()
    while True:
        chip.step()
        if listens is not None and chip.waiting:
            os.write(listens, b"%.1f" % ((time.monotonic() - began) / (chip.us * 1e-6)))
            os.close(listens)
            listens = None
        try:
            port.carry(chip)
            orders += os.read(config["orders"], 4096)
        except BlockingIOError:
            pass
        except EOFError:
            return
        while b"\n" in orders:
            order, _, orders = orders.partition(b"\n")
            word, _, rest = order.decode().partition(" ")
            if word == "source":
                hand.take(moments(Path(rest).read_bytes()))
        if chip.flash_commands != kept and time.monotonic() - kept_at > _KEEP_S:
            kept, kept_at = chip.flash_commands, time.monotonic()
            temporary = store / (BLOCKS + ".part")
            temporary.write_bytes(chip.files())
            temporary.replace(store / BLOCKS)


if __name__ == "__main__":
    run(json.loads(Path(sys.argv[1]).read_text()))

"""The bench's board behind a pseudo-terminal, for the host's own programs, which wait in the board's time.

The emulation takes some twenty times as long as the board would, and longer on a busy machine: a host that
counted its own seconds would give up on a board that answers in time.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from palpate.link.commands import PendingCommands
from palpate.sim.probe.relay import Relay
from palpate.stroke.replay import ReplayedStroke, replay
from tests.firmware_py.talk import Ears
from tests.sim.probe.board_bench import Board

LOOK_S = 0.02


class Terminal:
    """A board that runs by itself, in a thread. `port` is what the host opens."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self._ours, self._theirs = socket.socketpair()
        for end in (self._ours, self._theirs):
            end.setblocking(False)
        self._said: list[tuple[float, bytes]] = []  # device time in us, bytes
        self._closing = threading.Event()
        self._failure: BaseException | None = None
        self._relay = Relay(self._ours.fileno())
        self.port = self._relay.port
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._serve()
        except BaseException as failure:
            self._failure = failure
            raise

    def _serve(self) -> None:
        chip, waiting = self.board.chip, b""
        while not self._closing.is_set():
            chip.step()
            with suppress(BlockingIOError):
                chip.send(self._theirs.recv(4096))
            if data := chip.take():
                self._said.append((chip.us, data))
                waiting += data
            with suppress(BlockingIOError):
                waiting = waiting[self._theirs.send(waiting) :] if waiting else waiting

    def wait(self, pending: PendingCommands, number: int, timeout_s: float):
        """PendingCommands.wait in the board's time."""
        end_us = self.board.chip.us + 1e6 * timeout_s
        with pending._changed:
            while pending.get(number) is None and self.board.chip.us < end_us:
                if self._failure is not None:
                    raise self._failure
                pending._changed.wait(LOOK_S)
            return pending.get(number)

    def when_said(self, name: str) -> list[float]:
        """Device time, in us, at which each message of that name had gone over the terminal."""
        ears = Ears()
        return [us for us, data in self._said for message in ears.hear(data) if message.name == name]

    def close(self) -> None:
        """The board stands still again; what it said meanwhile is not heard by its bench."""
        self._closing.set()
        self._thread.join()
        self._relay.close()
        self._ours.close()
        self._theirs.close()


@contextmanager
def terminal(board: Board) -> Iterator[Terminal]:
    """The board on a terminal for as long as this lasts; hosts in this process wait in its time."""
    end = Terminal(board)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PendingCommands, "wait", lambda *arguments: end.wait(*arguments))
        try:
            yield end
        finally:
            end.close()


def streamed(board: Board, palpate: Callable, visit: Path, strokes: int) -> list[ReplayedStroke]:
    """What `palpate stream` records of a board's strokes, worked out once more: identical."""
    with terminal(board) as end:
        words = ("--strokes", strokes, "--record", visit, "--timeout", 36000)
        code, _, wrong = palpate("stream", "--port", end.port, *words)
    assert code == 0, wrong
    again = list(replay(visit))
    assert len(again) == strokes
    assert all(stroke.identical and stroke.features_equal for stroke in again)
    return again

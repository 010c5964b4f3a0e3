"""One open page: what is newest goes to it, and its commands are done in turn."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import time
from collections.abc import Sequence
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from palpate.view.commands import PageCommands
from palpate.view.mailbox import Mailbox, Message
from palpate.view.session import Session

SEND_INTERVAL_S = 1 / 65
"""A little more often than a screen draws, so that each redraw finds a new frame."""
MAX_UNDRAWN = 6
"""Frames on their way to a page that has not said it drew them (a tenth of a second); beyond that we wait,
and send the newest. With fewer, a machine so busy that messages are late by two pictures misses pictures."""
AGE_EVERY_S = 0.25
MAX_COMMAND_BYTES = 4096
MAX_ASKED = 64
"""Commands that wait for the one before them; a page that asks more is not read until there is room."""
SLOW = {"load-visit", "reference"}
"""Commands that read a whole file, or wait for a hand; they wait for one another only."""


class PageConnection:
    """One open page: a task that sends what is newest, one that reads what the page says, and two that do
    its commands in turn, quick and slow ones (a long one must hold up neither frames nor a recording)."""

    def __init__(self, session: Session, commands: PageCommands, ws: WebSocket) -> None:
        self._session = session
        self._commands = commands
        self._ws = ws
        self._mailbox: Mailbox = session.join()
        self._undrawn: list[tuple[int, float]] = []
        self._oldest_s = self._aged_at = 0.0
        self._sending = asyncio.Lock()
        self._asked: asyncio.Queue[object] = asyncio.Queue(MAX_ASKED)
        self._asked_slow: asyncio.Queue[object] = asyncio.Queue(MAX_ASKED)

    async def run(self) -> None:
        """Serve the page until it goes away."""
        work = (self._read(), self._carry_out(self._asked), self._carry_out(self._asked_slow), self._write())
        tasks = [asyncio.create_task(part) for part in work]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._session.leave(self._mailbox)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            if self._ws.application_state is WebSocketState.CONNECTED:
                with contextlib.suppress(RuntimeError, WebSocketDisconnect):
                    await self._ws.close()

    async def _write(self) -> None:
        async with self._sending:
            await self._send([self._session.snapshot()])
        due = time.monotonic()
        while True:
            await self._send_waiting(with_frame=len(self._undrawn) < MAX_UNDRAWN)
            now = time.monotonic()
            due = max(due + SEND_INTERVAL_S, now - SEND_INTERVAL_S)  # late by one frame at most
            await asyncio.sleep(max(due - now, 0.001))

    async def _send_waiting(self, *, with_frame: bool, then: Sequence[Message] = ()) -> None:
        """Send what waits in the mailbox, and `then` after it."""
        async with self._sending:
            if self._mailbox.overflowed:
                self._mailbox.reset()
                await self._send([self._session.snapshot()])
            messages = self._mailbox.take(with_frame=with_frame)
            for message in messages:
                if isinstance(message, bytes):
                    self._undrawn.append((int.from_bytes(message[4:8], "little"), time.monotonic()))
            await self._send([*messages, *then])

    async def _read(self) -> None:
        while True:
            try:
                message = await self._ws.receive()
            except (WebSocketDisconnect, RuntimeError):
                return
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text") or ""
            if not text or len(text) > MAX_COMMAND_BYTES:
                continue
            try:
                command = json.loads(text)
            except (ValueError, RecursionError):
                continue
            if isinstance(command, dict) and "drawn" in command:
                self._drawn(command["drawn"])
            else:
                await (self._asked_slow if _is_slow(command) else self._asked).put(command)

    async def _carry_out(self, asked: asyncio.Queue[object]) -> None:
        while True:
            answer = await run_in_threadpool(self._commands.run, await asked.get())
            # What the command changed (a recording runs) is sent before its answer.
            await self._send_waiting(with_frame=False, then=[answer])

    def _drawn(self, seq: Any) -> None:
        """The page drew this frame, and will not draw those sent before it."""
        for n, (sent_seq, sent_at) in enumerate(self._undrawn):
            if sent_seq == seq:
                del self._undrawn[: n + 1]
                now = time.monotonic()
                self._oldest_s = max(self._oldest_s, now - sent_at)
                if now - self._aged_at >= AGE_EVERY_S:
                    self._mailbox.put_slot(
                        "draw", {"type": "draw", "age_ms": round(self._oldest_s * 1000, 1)}
                    )
                    self._oldest_s, self._aged_at = 0.0, now
                return

    async def _send(self, messages: Sequence[Message]) -> None:
        for message in messages:
            if isinstance(message, bytes):
                await self._ws.send_bytes(message)
            else:
                await self._ws.send_text(to_json(message))


def _is_slow(command: object) -> bool:
    return isinstance(command, dict) and isinstance(do := command.get("do"), str) and do in SLOW


def to_json(message: Any) -> str:
    """JSON that browsers read: what is not finite becomes null."""
    try:
        return json.dumps(message, separators=(",", ":"), allow_nan=False)
    except ValueError:
        return json.dumps(_finite(message), separators=(",", ":"), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

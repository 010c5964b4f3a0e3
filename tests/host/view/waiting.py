"""Waiting for what must come, however slow the machine is: a minute's patience, and never a pause instead."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

from playwright.sync_api import Page, expect

from palpate.view.serve import Viewer
from tests.waiting import wait_until

PATIENCE_S = 60.0

WATCH = """
window.sockets = [];
window.WebSocket = class extends WebSocket {
  constructor(...words) { super(...words); window.sockets.push(this); }
};
window.toasts = [];
new MutationObserver((changes) => {
  for (const { target, addedNodes } of changes)
    if (target.id === "toasts") for (const note of addedNodes) window.toasts.push(note.textContent);
}).observe(document, { childList: true, subtree: true });
"""
"""Runs in every page before its own script: keeps the web sockets, and the notices after they have gone."""

_SEE = """([selector, text, patience_ms]) => new Promise((found, late) => {
  const holds = () => document.querySelector(selector)?.textContent.includes(text);
  if (holds()) return found();
  const look = new MutationObserver(() => holds() && done(found));
  const done = (end) => { look.disconnect(); clearTimeout(timer); end(); };
  const timer = setTimeout(() => done(() => late(new Error(`${selector} never said: ${text}`))), patience_ms);
  look.observe(document, { subtree: true, childList: true, characterData: true, attributes: true });
})"""


eventually = partial(wait_until, patience_s=PATIENCE_S)
"""Wait until something holds outside the page."""


def recording_begun(page: Page) -> None:
    """Press R; the page says that it records."""
    page.keyboard.press("r")
    expect(page.locator("#record-text")).to_contain_text("Stop")


def recording_ended(page: Page) -> None:
    """Press R again; the page says that it does no longer."""
    page.keyboard.press("r")
    expect(page.locator("#record-text")).to_have_text("Record")


def see(page: Page, selector: str, text: str = "") -> None:
    """Wait until an element is there and says something, be it between two pictures only."""
    page.evaluate(_SEE, [selector, text, 1000 * PATIENCE_S])


def noticed(page: Page, text: str) -> None:
    """Wait for a notice; it may have come and gone."""
    page.wait_for_function("(text) => window.toasts.some((toast) => toast.includes(text))", arg=text)


def settled(page: Page) -> None:
    """Whatever has reached the page has been worked on, and drawn."""
    for _ in range(3):
        page.evaluate("() => new Promise((go) => requestAnimationFrame(() => setTimeout(go)))")


class Held:
    """A command of the page that is held back until `let_go`."""

    def __init__(self) -> None:
        self.arrived = threading.Event()
        self._go = threading.Event()

    def let_go(self) -> None:
        """Go on, for this time and all others."""
        self._go.set()

    def wait(self) -> None:
        """Say that it has come this far, and stand still."""
        self.arrived.set()
        assert self._go.wait(PATIENCE_S), "nobody let it go on"


@contextmanager
def held(viewer: Viewer, command: str, *, done: bool = True) -> Iterator[Held]:
    """Hold the answer to a command back, or (with `done` false) the command itself."""
    run = viewer.commands.table[command]
    hold = Held()

    def slow(message):
        if not done:
            hold.wait()
        try:
            return run(message)
        finally:
            if done:
                hold.wait()

    viewer.commands.table[command] = slow
    try:
        yield hold
    finally:
        hold.let_go()
        viewer.commands.table[command] = run

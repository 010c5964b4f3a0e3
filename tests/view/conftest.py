"""Pages in a real browser, on made-up sources and on the emulated probe."""

from __future__ import annotations

import os
import shutil
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from host.view.serve import Viewer
from host.view.source import Source
from tests.host.conftest import (  # noqa: F401  (fixtures: emulated probes and a model for them)
    bench,
    emulated,
    images,
    key_dir,
    own_directories,
    public_key,
    specs,
    strokes,
)
from tests.view.waiting import PATIENCE_S, WATCH

CHROMIUM_OPTIONS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
PICTURES = Path(__file__).parents[2] / "docs" / "pictures"


def chromium() -> str:
    """Debian's Chromium, or one that the environment names."""
    found = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    assert found, "no Chromium; run: .ci/setup test"
    return found


@pytest.fixture(scope="session")
def browser():
    from playwright.sync_api import expect, sync_playwright

    expect.set_options(timeout=1000 * PATIENCE_S)
    with (
        sync_playwright() as playwright,
        playwright.chromium.launch(
            executable_path=chromium(), args=CHROMIUM_OPTIONS, timeout=2000 * PATIENCE_S
        ) as opened,
    ):
        yield opened


@pytest.fixture
def viewer(tmp_path) -> Iterator[Callable[..., Viewer]]:
    """Starts viewers, and ends them."""
    with ExitStack() as stack:

        def start(source: Source, mode: str = "live", **words) -> Viewer:
            words.setdefault("recordings", tmp_path / "recordings")
            return stack.enter_context(Viewer(source, mode=mode, **words))

        yield start


@pytest.fixture
def open_page(browser):
    """Opens a viewer's page; at the end nothing may have gone wrong in it.

    PALPATE_TEST_SLOWDOWN=6 gives every page a sixth of the processor: no test may mind.
    """
    pages, wrong = [], []

    def open_it(viewer: Viewer, width: int = 1280, height: int = 800, scheme: str = "dark", script: str = ""):
        context = browser.new_context(
            viewport={"width": width, "height": height}, color_scheme=scheme, has_touch=width < 600
        )
        page = context.new_page()
        page.set_default_timeout(1000 * PATIENCE_S)
        page.add_init_script(WATCH + script)
        if slowdown := os.environ.get("PALPATE_TEST_SLOWDOWN"):
            throttle = {"rate": float(slowdown)}
            context.new_cdp_session(page).send("Emulation.setCPUThrottlingRate", throttle)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on(
            "console",
            lambda message: (
                wrong.append(message.text)
                if message.type == "error" and "WebSocket connection" not in message.text
                else None
            ),
        )
        page.goto(viewer.url)
        pages.append(page)
        return page

    yield open_it
    for page in pages:
        page.context.close()
    assert wrong == []


def free_port() -> int:
    """A TCP port that nobody gets by asking for any: it stays free until somebody names it."""
    for port in range(20_000 + os.getpid() % 10_000, 32_000):
        with socket.socket() as probe, suppress(OSError):
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(("127.0.0.1", port))
            return port
    raise AssertionError("no free port")

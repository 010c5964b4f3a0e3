"""Pages in a real browser, on made-up sources and on the emulated probe."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from palpate.view.serve import Viewer
from palpate.view.source import Source
from tests.host.view.chromium import CHROMIUM_OPTIONS, chromium
from tests.host.view.waiting import PATIENCE_S, WATCH

GONE = ("WebSocket connection", "net::ERR_CONNECTION_REFUSED")
"""What the browser itself notes when a viewer program has ended: no fault of the page."""


@pytest.fixture(scope="session")
def launch():
    """Launches Chromium, with further options."""
    from playwright.sync_api import expect, sync_playwright

    expect.set_options(timeout=1000 * PATIENCE_S)
    with sync_playwright() as playwright, ExitStack() as stack:

        def start(*options: str):
            opened = playwright.chromium.launch(
                executable_path=chromium(), args=[*CHROMIUM_OPTIONS, *options], timeout=2000 * PATIENCE_S
            )
            return stack.enter_context(opened)

        yield start


@pytest.fixture(scope="session")
def browser(launch):
    return launch()


@pytest.fixture
def viewer(tmp_path) -> Iterator[Callable[..., Viewer]]:
    """Starts viewers, and ends them."""
    with ExitStack() as stack:

        def start(source: Source, mode: str = "live", **options) -> Viewer:
            options.setdefault("recordings", tmp_path / "recordings")
            return stack.enter_context(Viewer(source, mode=mode, **options))

        yield start


@pytest.fixture
def open_page(browser):
    """Opens a viewer's page; at the end nothing may have gone wrong in it.

    PALPATE_TEST_SLOWDOWN=6 gives every page a sixth of the processor: no test may mind.
    """
    pages, wrong = [], []

    def open_it(
        viewer: Viewer,
        width: int = 1280,
        height: int = 800,
        scheme: str = "dark",
        script: str = "",
        before=None,
    ):
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
                if message.type == "error" and not any(text in message.text for text in GONE)
                else None
            ),
        )
        if before:
            before(page)
        page.goto(viewer.url)
        pages.append(page)
        return page

    yield open_it
    for page in pages:
        page.context.close()
    assert wrong == []

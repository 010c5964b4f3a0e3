"""Pages and what they are fed with, for the tests in a browser."""

from __future__ import annotations

from playwright.sync_api import expect

from tests.host.view.synthetic import Bump, SyntheticSource
from tests.host.view.waiting import eventually

LUMP = Bump(d_mm=10.0, h=0.8)


def told(source: SyntheticSource, wanted: list[str]) -> None:
    """Wait until the page has asked for all this, and find that it asked for nothing else."""
    eventually(lambda: len(source.told) >= len(wanted), lambda: source.told)
    assert source.told == wanted


def opened(viewer, open_page, source, mode="live", before=None, **words):
    """A page that has been told how things stand; `before` has it ahead of its first request."""
    running = viewer(source, mode=mode, **words)
    page = open_page(running, before=before)
    expect(page.locator("body")).to_have_attribute("data-link", "connected")
    return running, page


def pick(page, number: int) -> None:
    """Pick a stroke from the list; its image is shown then."""
    page.locator(f"#stroke-{number}").click()
    expect(page.locator("#image-note")).to_have_text(f"stroke {number}")


def new_visit(page, name: str = "") -> None:
    """Begin one from the keyboard."""
    page.keyboard.press("v")
    page.locator("#text-value").fill(name)
    page.keyboard.press("Enter")


def once(*bumps: Bump) -> SyntheticSource:
    """One stroke over each, and then a page where nothing moves any more."""
    return SyntheticSource(list(bumps), seconds=0.4, rest=0.0, limit=len(bumps))

"""The documentation builds as a site without a warning, and its pages fetch nothing from the net."""

import os
import re
import subprocess
from concurrent.futures import ThreadPoolExecutor
from html.parser import HTMLParser
from pathlib import Path

import pytest
from playwright.sync_api import sync_playwright

from tests.docs.blocks import ROOT
from tests.host.view.chromium import CHROMIUM_OPTIONS, chromium

_LOADS = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src", "video": "src"}
_HARMLESS_LINKS = {"canonical", "prev", "next", "alternate"}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site's directory."""
    out = tmp_path_factory.mktemp("site")
    subprocess.run([ROOT / ".ci/links"], check=True)
    done = subprocess.run(
        [ROOT / ".venv/bin/mkdocs", "build", "--strict", "--site-dir", out],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=900,
    )
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    assert "WARNING" not in said, said
    return out


def searched(address: str, word: str) -> tuple[str, list[str]]:
    """What the page's search finds first, and every address that the browser asked for."""
    asked: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=CHROMIUM_OPTIONS)
        page = browser.new_page()
        page.on("request", lambda request: asked.append(request.url))
        page.goto(address)
        page.wait_for_function("typeof __index === 'object'", timeout=120_000)
        page.locator("[data-md-component=search-query]").click()
        page.keyboard.type(word)
        first = page.locator(".md-search-result__item a").first
        first.wait_for(timeout=120_000)
        target = first.get_attribute("href") or ""
        browser.close()
    return target, asked


@pytest.mark.browser
def test_search_works_from_a_disk(site):
    with ThreadPoolExecutor(1) as another:  # this one may have a browser already, for the viewer's tests
        address = (site / "tutorial" / "emulated.html").as_uri()
        target, asked = another.submit(searched, address, "curvature").result()
    assert re.match(r"(\.\./|file:).*\.html", target), target
    assert all(address.startswith(("file:", "data:", "about:", "blob:")) for address in asked), asked


class Loads(HTMLParser):
    """What a browser would fetch for a page."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []

    def handle_starttag(self, tag, attrs):
        words = dict(attrs)
        if tag == "link" and words.get("rel") in _HARMLESS_LINKS:
            return
        if address := words.get(_LOADS.get(tag, "")):
            self.addresses.append(address)


def test_nothing_is_fetched_from_elsewhere(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 20
    for page in pages:
        loads = Loads()
        loads.feed(page.read_text(encoding="utf-8"))
        assert loads.addresses
        outside = [a for a in loads.addresses if re.match(r"(https?:)?//", a)]
        assert not outside, f"{page.relative_to(site)} fetches {outside}"
    for style in site.rglob("*.css"):
        assert not re.search(r"(url\(|@import)\s*[\"']?(https?:)?//", style.read_text(encoding="utf-8")), (
            style
        )


def test_no_page_uses_a_diagram_that_the_browser_would_fetch_a_script_for(site):
    """Material loads Mermaid and MathJax from the net; drawn SVG and plain formulas need neither."""
    for page in site.rglob("*.html"):
        assert not re.search(r'class="(mermaid|arithmatex)"', page.read_text(encoding="utf-8")), page.name


def test_pages_that_readers_look_for_are_there(site):
    for name in (
        "tutorial/emulated",
        "tutorial/board",
        "howto/client",
        "reference/python",
        "protocol",
        "physics",
    ):
        assert (site / f"{name}.html").is_file(), name
    python = (site / "reference/python.html").read_text(encoding="utf-8")
    assert "d_mm" in python and "Raises" in python


def test_every_page_is_in_the_navigation(site):
    """Strict mode does not say so by itself; `validation` in mkdocs.yml does."""
    assert re.search(r"omitted_files: warn", Path(ROOT / "mkdocs.yml").read_text())

"""The viewer: frames drawn in a second from a stream of 200, and how old they are: python -m
tests.benchmarks view.

The page runs in Chromium without a graphics processor, so that its drawing shares the processor with the
viewer program; a desktop's browser has more room. Half of the run the processor is kept from the page by a
busy loop of 60 ms in every 100: what is drawn gets less and must not get older.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from palpate.view.serve import Viewer
from palpate.view.session import Session, pack_frame
from palpate.wire.events import Frame
from tests.host.view.chromium import CHROMIUM_OPTIONS, chromium
from tests.host.view.synthetic import Bump, SyntheticSource, stroke

RATE = 200.0
SECONDS = 10

_COUNT = """async (seconds) => {
  const begin = performance.now();
  let drawn = 0;
  const send = WebSocket.prototype.send;
  WebSocket.prototype.send = function (text) {
    if (text.startsWith('{"drawn"')) drawn++;
    return send.call(this, text);
  };
  const ages = [];
  while (performance.now() - begin < 1000 * seconds) {
    await new Promise((go) => setTimeout(go, 100));
    ages.push(Number(document.getElementById("h-age").textContent));
  }
  WebSocket.prototype.send = send;
  return [drawn / seconds, ages];
}"""
_BUSY = """() => { setInterval(() => { const t = performance.now(); while (performance.now() - t < 60); },
100); }"""


def main() -> None:
    """Print the table."""
    _ingest()
    for width, height in ((1280, 800), (390, 844)):
        _page(width, height)


def _ingest() -> None:
    """How many frames a second the session takes, with one page that never reads."""
    session = Session(mode="live", name="bench")
    mailbox = session.join()
    events = list(stroke(Bump(), 0.0, 0, 1000.0, 2.0, 1))
    begin = time.process_time()
    for event in events:
        session.on_event(event)
    spent = time.process_time() - begin
    size = len(pack_frame(next(e for e in events if isinstance(e, Frame))))
    rate = len(events) / spent
    print(f"session: {rate:,.0f} events/s on one core, {size} bytes a frame, {len(mailbox)} messages wait")


def _page(width: int, height: int) -> None:
    from playwright.sync_api import sync_playwright

    with (
        tempfile.TemporaryDirectory() as folder,
        Viewer(
            SyntheticSource([Bump()], rate=RATE, seconds=8.0, rest=0.01), mode="live", recordings=Path(folder)
        ) as viewer,
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=chromium(), args=CHROMIUM_OPTIONS) as browser,
    ):
        page = browser.new_page(viewport={"width": width, "height": height})
        page.goto(viewer.url)
        page.wait_for_function("() => document.getElementById('h-age').textContent !== '–'")
        _report(f"{width} x {height}", *page.evaluate(_COUNT, SECONDS))
        page.evaluate(_BUSY)
        _report(f"{width} x {height}, page busy 60 %", *page.evaluate(_COUNT, SECONDS))


def _report(name: str, drawn: float, ages: list[float]) -> None:
    third = len(ages) // 3
    early, late = sorted(ages[:third]), sorted(ages[-third:])
    first, last = early[third // 2], late[third // 2]
    print(
        f"{name}: {drawn:.0f} frames/s drawn of {RATE:.0f}; "
        f"sent to drawn {first:.0f} ms at first, {last:.0f} ms at last (medians), {max(ages):.0f} ms at most"
    )


if __name__ == "__main__":
    main()

"""A page of another site, whose name comes to point at this machine, gets nothing from an open viewer."""

from __future__ import annotations

from urllib.parse import urlsplit

import pytest

from tests.host.view.synthetic import Bump, SyntheticSource

EVIL = "evil.example"
TRIED = """async () => {
    const said = {};
    for (const path of ["/", "/api/strokes.csv", "/static/main.js"])
        said[path] = (await fetch(path, {credentials: "include"})).status;
    const model = {method: "POST", headers: {"x-palpate": "page"}, body: "model"};
    said.model = (await fetch("/api/model", model)).status;
    said.socket = await new Promise((done) => {
        const socket = new WebSocket(`ws://${location.host}/ws`);
        socket.onopen = () => setTimeout(() => done("open"), 500);
        socket.onmessage = () => done("heard");
        socket.onclose = () => done("closed");
    });
    return said;
}"""


@pytest.fixture(scope="module")
def rebound(launch):
    """A browser for which the other site's name means this machine."""
    return launch(f"--host-resolver-rules=MAP {EVIL} 127.0.0.1")


@pytest.mark.parametrize(("host", "refusal"), [("127.0.0.1", 403), ("0.0.0.0", 401)])
def test_a_name_that_was_rebound_to_this_machine_opens_nothing(viewer, rebound, host, refusal):
    """On every address, the name cannot be known: there the cookie, which is another name's, is not sent."""
    running = viewer(SyntheticSource([Bump()]), host=host)
    address = urlsplit(running.url)
    context = rebound.new_context()
    own = context.new_page()
    own.goto(f"http://localhost:{address.port}/?{address.query}")
    assert own.title().startswith("Palpate") and context.cookies()
    page = context.new_page()
    assert page.goto(f"http://{EVIL}:{address.port}/").status == refusal
    said = page.evaluate(TRIED)
    context.close()
    assert said.pop("socket") == "closed"
    assert set(said.values()) == {refusal}

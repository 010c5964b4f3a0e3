"""Who is let in: a token for every address, a code that is good once, a cookie for one viewer."""

from __future__ import annotations

import http.client
import json
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from palpate.view.guard import COOKIE, cookie_name
from palpate.view.serve import Viewer
from tests.host.view.synthetic import Bump, SyntheticSource
from tests.host.view.waiting import PATIENCE_S


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    (folder.parent / "secret.mcap").write_bytes(b"not for the page")
    with Viewer(SyntheticSource([Bump()]), mode="live", recordings=folder, token="") as viewer:
        yield viewer


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    source = SyntheticSource([Bump()])
    with Viewer(source, mode="live", recordings=tmp_path_factory.mktemp("r"), token="open sesame") as viewer:
        yield viewer


def ask(viewer, path, method="GET", **headers):
    address = urlsplit(viewer.url)
    connection = http.client.HTTPConnection("127.0.0.1", address.port, timeout=PATIENCE_S)
    connection.putrequest(method, path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name.replace("_", "-"), value)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def run_command(viewer, **command):
    address = urlsplit(viewer.url)
    with connect(f"ws://127.0.0.1:{address.port}/ws", max_size=None) as page:
        page.send(json.dumps({"id": 1, **command}))
        while True:
            message = page.recv(PATIENCE_S)
            if isinstance(message, str) and (answer := json.loads(message)).get("type") == "answer":
                return answer


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_every_address_makes_a_token_up(tmp_path, host):
    """Without one on localhost, any user of the machine could operate the page."""
    viewer = Viewer(SyntheticSource([]), mode="live", host=host, recordings=tmp_path)
    try:
        assert viewer.token is not None and len(viewer.token) >= 32
        assert f"?token={viewer.token}" in viewer.url
    finally:
        viewer.close()


def test_the_browser_gets_a_code_that_is_good_once(guarded):
    code = guarded._code()
    assert ask(guarded, f"/static/main.js?token={code}x")[0].status == 401
    answer, _ = ask(guarded, f"/?token={code}")
    assert answer.status == 303 and "open sesame" in answer.headers["set-cookie"].replace("%20", " ")
    assert ask(guarded, f"/?token={code}")[0].status == 401


def test_two_viewers_of_one_machine_do_not_take_each_others_cookie():
    assert cookie_name("localhost:8765") != cookie_name("localhost:8766")
    assert cookie_name("localhost") == cookie_name("localhost:80") and cookie_name("[") == COOKIE


def test_without_the_token_nothing_is_answered(guarded):
    port = urlsplit(guarded.url).port
    for path in ("/", "/static/main.js", "/api/strokes.csv", "/?token=wrong", "/api/stroke-1.json"):
        assert ask(guarded, path)[0].status == 401
    assert ask(guarded, "/", Authorization="Bearer nonsense")[0].status == 401
    with pytest.raises((InvalidStatus, ConnectionClosed)):
        connect(f"ws://127.0.0.1:{port}/ws").recv(PATIENCE_S)


def test_the_token_moves_from_the_address_into_a_cookie(guarded):
    answer, _ = ask(guarded, "/?token=open%20sesame")
    assert answer.status == 303 and answer.headers["location"] == "/"
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie and "SameSite=strict" in cookie
    assert ask(guarded, "/", Cookie=cookie.split(";")[0])[0].status == 200
    assert ask(guarded, "/", Authorization="Bearer open sesame")[0].status == 200

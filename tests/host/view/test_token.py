"""Who is let in: a token for every address, a code that is good once, a cookie for one viewer."""

from __future__ import annotations

from urllib.parse import urlsplit

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from palpate.view.guard import COOKIE, cookie_name
from palpate.view.serve import Viewer
from tests.host.view.asking import ask, guarded, running
from tests.host.view.synthetic import SyntheticSource
from tests.host.view.waiting import PATIENCE_S

__all__ = ["guarded", "running"]


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

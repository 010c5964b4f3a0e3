"""Who may talk to the viewer: nobody reaches files, settings or calibration by way of the page."""

from __future__ import annotations

import ast
import json
import urllib.error
import urllib.request
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from palpate.cli import view
from palpate.link.probe import Probe
from palpate.view import commands
from tests.host.view.asking import ask, by_number, guarded, run_command, running
from tests.host.view.waiting import PATIENCE_S

__all__ = ["guarded", "running"]


def test_the_page_is_served_on_localhost_with_headers_that_keep_other_sites_out(running):
    answer, body = ask(running, "/")
    assert answer.status == 200 and b"Palpate" in body
    assert "default-src 'self'" in answer.headers["content-security-policy"]
    assert answer.headers["x-frame-options"] == "DENY"


def test_other_machines_cannot_even_connect_unless_an_address_is_named(running):
    assert running._socket.getsockname()[0] == "127.0.0.1"
    assert next(o for o in view.command.params if o.name == "host").default == "127.0.0.1"


def test_a_name_that_is_not_localhost_is_refused(running):
    answer, _ = ask(running, "/", Host="evil.example")
    assert answer.status == 403


def test_another_sites_page_is_refused(running):
    port = urlsplit(running.url).port
    assert ask(running, "/api/strokes.csv", Origin="http://evil.example")[0].status == 403
    with pytest.raises(InvalidStatus):
        connect(f"ws://127.0.0.1:{port}/ws", origin="http://evil.example")
    with connect(f"ws://127.0.0.1:{port}/ws", origin=f"http://127.0.0.1:{port}"):
        pass


PATHS = st.lists(
    st.sampled_from(
        ["..", "%2e%2e", "static", "api", "etc", "passwd", ".", "%2f", "%5c", "secret.mcap", "//", "%00"]
    ),
    min_size=1,
    max_size=7,
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(parts=PATHS)
def test_no_path_leads_to_a_file_of_the_host(running, parts):
    answer, body = ask(running, "/" + "/".join(parts))
    assert b"root:" not in body and b"not for the page" not in body
    assert answer.status in (200, 303, 307, 400, 404)
    if answer.status == 200:
        assert b"<title>Palpate</title>" in body


def test_a_visit_is_loaded_by_name_from_one_folder_only(running, tmp_path):
    for name in ("../secret.mcap", "/etc/passwd", "..\\secret.mcap", "", ".", "secret.mcap\0"):
        answer = run_command(running, do="load-visit", file=name)
        assert not answer["ok"] and "There is no recording" in answer["text"]


def test_a_link_in_the_folder_leads_nowhere(running):
    folder = running.commands._recordings
    (folder / "linked.mcap").symlink_to(folder.parent / "secret.mcap")
    assert "linked.mcap" not in run_command(running, do="recordings")["files"]


def test_a_recordings_name_stays_inside_the_folder(running):
    answer = run_command(running, do="record", name="../../../tmp/evil\0/x")
    assert answer["ok"] and "/" not in answer["file"] and ".." not in answer["file"]
    run_command(running, do="stop-recording")
    assert [p.parent for p in running.source.recorded] == [running.commands._recordings]


def test_there_is_no_command_that_reaches_the_probes_settings(running):
    known = set(running.commands.table)
    assert known == {
        "record", "stop-recording", "mark", "new-visit", "recordings", "load-visit",
        "repeatability", "compare", "play", "pause", "seek", "speed", "reference", "forget-reference",
        "lanes",
    }  # fmt: skip
    for word in ("flash", "flash_begin", "set_setting", "calibrate", "__class__", "run"):
        assert "no command" in run_command(running, do=word)["text"]


def test_no_line_of_the_viewer_names_a_way_to_the_probes_settings_or_calibration():
    """What a page's command could call at all: the link's methods that change the probe are not there. Only
    a model is given to it, as a whole, and the probe itself judges that."""
    changes = {"command", "set_setting", "calibrate_zero", "calibrate_gain", "forget_calibration"}
    assert changes <= set(dir(Probe)), "the link has other names for these now"
    used = set()
    for path in Path(commands.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute):
                used.add(node.attr)
            elif isinstance(node, ast.ImportFrom) and node.module:
                used |= {node.module.rpartition(".")[2], *(name.name for name in node.names)}
    assert "read_back" in used, "the viewer asks for the calibration, so what it calls is seen here"
    assert not used & changes


def send_model(viewer, model=b"model", **headers):
    """What the viewer answers to a page that sends a model."""
    request = urllib.request.Request(by_number(viewer.url) + "api/model", model, headers, method="POST")
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


FROM_THE_PAGE = {"x-palpate": "page"}


@pytest.mark.parametrize("headers", [{}, FROM_THE_PAGE | {"origin": "http://evil.example"}])
def test_no_other_sites_page_can_send_a_model(running, headers):
    with pytest.raises(urllib.error.HTTPError) as refused:
        send_model(running, **headers)
    assert refused.value.code == 403


def test_a_source_that_takes_no_model_says_so(running):
    said = "A recording takes no model; the probe that it came from does."
    assert send_model(running, **FROM_THE_PAGE) == {"ok": False, "text": said}


def test_a_file_that_is_too_large_for_a_model_is_not_read_to_its_end(running):
    with pytest.raises((urllib.error.HTTPError, ConnectionError, urllib.error.URLError)) as refused:
        send_model(running, bytes(1 << 20), **FROM_THE_PAGE)
    if isinstance(refused.value, urllib.error.HTTPError):
        assert refused.value.code == 413


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    do=st.sampled_from(
        ["mark", "repeatability", "compare", "seek", "speed", "load-visit", "play", "new-visit", "?"]
    )
    | JSON,
    words=st.dictionaries(
        st.sampled_from(["visit", "a", "b", "last", "position_s", "speed", "file", "name", "text"]), JSON
    ),
)
def test_whatever_a_page_sends_is_answered_with_a_sentence(running, do, words):
    answer = running.commands.run({**words, "do": do})
    assert answer["ok"] or answer["text"].endswith(".")


def test_a_page_that_sends_rubbish_is_still_served(running):
    address = urlsplit(running.url)
    with connect(f"ws://127.0.0.1:{address.port}/ws", max_size=None) as page:
        for rubbish in (
            "{",
            "[]",
            "null",
            "[" * 3000,
            '{"drawn": "x"}',
            '{"drawn": 1e99}',
            b"\xff\x00",
            "x" * 5000,
        ):
            page.send(rubbish)
        page.send(json.dumps({"do": "recordings", "id": 7}))
        message = page.recv(PATIENCE_S)
        while isinstance(message, bytes) or json.loads(message).get("id") != 7:
            message = page.recv(PATIENCE_S)


MANY = "&".join(f"a{k}=1" for k in range(40))


@pytest.mark.parametrize(
    "path",
    ["/?" + MANY, "/?token=open%20sesame&" + MANY, "/?token=%00%ff", "/api/stroke-" + 9000 * "9" + ".json"],
)
def test_an_address_of_any_shape_is_answered_without_a_traceback(guarded, path, capfd):
    """More than 32 fields gave 500, and a traceback in the terminal, to anybody without a token."""
    assert ask(guarded, path)[0].status in (303, 400, 401, 404)
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("origin", ["http://[::1", "http://[", "null", "", "http://localhost:x"])
def test_an_origin_of_any_shape_is_refused_without_a_traceback(guarded, origin, capfd):
    assert ask(guarded, "/", Origin=origin)[0].status == 403
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize(
    "path", ["//evil.example/", "///evil.example/", "/\\\\evil.example/", "/%5C%5Cevil.example/"]
)
def test_the_token_is_exchanged_on_this_site_and_leads_to_no_other(guarded, path):
    """//evil.example/?token=... sent the browser there."""
    answer, _ = ask(guarded, f"{path}?token=open%20sesame")
    assert answer.status == 303
    where = answer.headers["location"].replace("\\", "/")
    assert where.startswith("/") and not where.startswith("//")

"""A viewer and a guarded one, and how a test asks them without a browser."""

from __future__ import annotations

import http.client
import json
from urllib.parse import urlsplit

import pytest
from websockets.sync.client import connect

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


def by_number(url):
    """The same address without a name: a bare system has no /etc/hosts, and knows no localhost."""
    return url.replace("//localhost:", "//127.0.0.1:")


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

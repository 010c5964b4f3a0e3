"""Runs the viewer: the source in its thread, the web server in this one."""

from __future__ import annotations

import asyncio
import logging
import secrets
import socket
import threading
import webbrowser
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

import uvicorn

from palpate.answer.visit import POOLS_WITH
from palpate.stroke.change import Between
from palpate.view.app import make_app
from palpate.view.commands import LoadStrokes, PageCommands
from palpate.view.guard import is_loopback
from palpate.view.notices import LinkChanged, LinkState
from palpate.view.session import Session
from palpate.view.source import Emit, Source

_log = logging.getLogger(__name__)


class Viewer:
    """A viewer that can be started, asked for its address, and stopped (a context manager).

    Parameters
    ----------
    source : Source
    mode : "live" or "replay"
    host, port : where to listen; port 0 takes a free one
    recordings : the folder for recordings
    load_strokes : reads the strokes of an earlier recording
    token : ask for this token; by default one is made up, and where it is empty nobody is asked (in a test)
    fat_kPa : Young's modulus of the fat, where it is known: stiffness is said in kPa, too
    between : what visits differ by themselves (`comparison.between`), by quantity
    beside : what is to see the source's events, too (`view.refined`)

    Raises
    ------
    OSError
        The address cannot be listened on.
    """

    def __init__(
        self,
        source: Source,
        *,
        mode: str,
        host: str = "127.0.0.1",
        port: int = 0,
        recordings: Path = Path("recordings"),
        load_strokes: LoadStrokes = lambda path: (),
        token: str | None = None,
        fat_kPa: float | None = None,
        between: Mapping[str, Between] | None = None,
        beside: Callable[[Emit, threading.Event], Emit] | None = None,
    ) -> None:
        self.token = secrets.token_urlsafe(24) if token is None else token
        self._once: set[str] = set()
        self.source, self._beside = source, beside
        self.session = Session(mode=mode, name=source.name, fat_kPa=fat_kPa)
        self.session.visits.between = between or {}
        self.commands = PageCommands(self.session, source, recordings, load_strokes)
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_STREAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._socket.bind((host, port))
            self._socket.listen(64)  # connections made before the server runs wait instead of being refused
        except OSError:
            self._socket.close()
            raise
        self._stop = threading.Event()
        self._server = uvicorn.Server(
            uvicorn.Config(
                make_app(
                    self.session, self.commands, token=self.token, loopback=is_loopback(host), once=self._once
                ),
                log_level="warning",
                access_log=False,
                ws="websockets-sansio",
                ws_max_size=64 * 1024,
                ws_ping_interval=10.0,
                timeout_graceful_shutdown=1,
                lifespan="off",
            )
        )
        self._threads: list[threading.Thread] = []
        threading.Thread(target=import_module, args=(POOLS_WITH,), daemon=True).start()  # takes seconds

    @property
    def url(self) -> str:
        """What to open in the browser, with the token."""
        return self._url(self.token)

    def _url(self, token: str) -> str:
        host, port = self._socket.getsockname()[:2]
        name = {"0.0.0.0": socket.gethostname(), "::": socket.gethostname()}.get(host, host)
        if is_loopback(host):
            name = "localhost" if host == "127.0.0.1" else f"[{host}]" if ":" in host else host
        elif ":" in name:
            name = f"[{name}]"
        return f"http://{name}:{port}/" + (f"?token={token}" if token else "")

    def run(self, *, open_browser: bool = False, on_ready: Callable[[str], None] | None = None) -> None:
        """Serve in this thread until interrupted."""
        self._start_source()
        url = self.url
        if on_ready is not None:
            on_ready(url)
        if open_browser:
            threading.Thread(target=webbrowser.open, args=(self._url(self._code()),), daemon=True).start()
        try:
            self._serve()
        finally:
            self.close()

    def _code(self) -> str:
        """What opens the page once: every user can read what a browser is started with."""
        if not self.token:
            return ""
        code = secrets.token_urlsafe(24)
        self._once.add(code)
        return code

    def __enter__(self) -> Viewer:
        self._start_source()
        thread = threading.Thread(target=self._serve, name="viewer", daemon=True)
        thread.start()
        self._threads.append(thread)
        return self

    def __exit__(self, *exception: object) -> None:
        self._server.should_exit = True
        self.close()

    def close(self) -> None:
        """Stop the source, close a running recording, give the port back."""
        self._stop.set()
        self.commands.close()
        for thread in self._threads:
            # The socket may be closed only once the server has stopped; a source may still hang on its port.
            thread.join(5.0 if thread.name == "source" else None)
        self._socket.close()

    def _serve(self) -> None:
        asyncio.run(self._server.serve(sockets=[self._socket]))

    def _start_source(self) -> None:
        thread = threading.Thread(target=self._run_source, name="source", daemon=True)
        thread.start()
        self._threads.append(thread)

    def _run_source(self) -> None:
        try:
            emit: Emit = self.session.on_event
            self.source.run(self._beside(emit, self._stop) if self._beside else emit, self._stop)
        except Exception as error:  # the page must say what happened, whatever it was
            _log.exception("the source stopped")
            self.session.on_event(LinkChanged(LinkState.GONE, f"The source stopped: {error}"))

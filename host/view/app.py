"""The web application: one page, one web socket, and exports.

Routes name what they serve; no path comes from outside.
"""

from __future__ import annotations

import base64
import mimetypes
from importlib.resources import files

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from palpate.view import exports
from palpate.view.commands import PageCommands
from palpate.view.guard import Guard
from palpate.view.page_connection import PageConnection
from palpate.view.session import Session
from palpate.wire.cells import PITCH_MM, SHAPE

MAX_MODEL_BYTES = 64 * 1024
"""Several times what a probe has room for."""

FONT = ("fonts", "node_modules", "@fontsource-variable", "inter", "files", "inter-latin-wght-normal.woff2")
"""Inter (SIL Open Font License), as npm has installed it: .ci/setup and the wheel see to it."""


def page_files() -> dict[str, bytes]:
    """The page's files by name, read once; nothing else can be asked for."""
    folder = files("palpate.view")
    found = {f.name: f.read_bytes() for f in (folder / "page").iterdir() if f.is_file()}
    if (font := folder.joinpath(*FONT)).is_file():  # without it the page is laid out in the system's own
        found["text.woff2"] = font.read_bytes()
    found["array.js"] = array_module()
    return found


def array_module() -> bytes:
    """The sensor array for the page, as a module that its scripts import."""
    rows, columns = SHAPE
    numbers = {"ROWS": rows, "COLUMNS": columns, "CELLS": rows * columns, "PITCH_MM": PITCH_MM}
    return "".join(f"export const {name} = {number};\n" for name, number in numbers.items()).encode()


def color_maps() -> dict[str, str]:
    """Perceptually even colour maps as 256 RGB triples in base64, from matplotlib's tables."""
    import matplotlib

    tables = {}
    for name in ("viridis", "cividis", "magma"):
        rgb = (matplotlib.colormaps[name](range(256))[:, :3] * 255).round().astype("uint8")
        tables[name] = base64.b64encode(rgb.tobytes()).decode("ascii")
    return tables


def make_app(
    session: Session,
    commands: PageCommands,
    *,
    token: str = "",
    loopback: bool = True,
    once: set[str] | None = None,
) -> Starlette:
    """The viewer as an ASGI application.

    Parameters
    ----------
    token, loopback, once
        Who is let in (`guard.Guard`).
    """
    page = page_files()

    async def index(request: Request) -> Response:
        return Response(page["index.html"], media_type="text/html")

    async def static(request: Request) -> Response:
        name = request.path_params["name"]
        if name not in page:
            return PlainTextResponse("There is no such file.\n", 404)
        return Response(page[name], media_type=mimetypes.guess_type(name)[0] or "application/octet-stream")

    async def maps(request: Request) -> Response:
        return JSONResponse(color_maps(), headers={"cache-control": "max-age=86400"})

    async def stroke(request: Request) -> Response:
        with session.lock:
            found = session.visits.get(request.path_params["number"])
            if found is None:
                return PlainTextResponse("There is no such stroke.\n", 404)
            detail = found.detail()
        kind = request.path_params["kind"]
        if kind not in exports.STROKE_KINDS:
            return PlainTextResponse("Strokes come as json, csv, png or svg.\n", 404)
        body, media_type = await run_in_threadpool(exports.stroke, detail, kind)
        return _download(body, media_type, f"stroke-{detail['number']}.{kind}", inline=kind == "json")

    async def strip(request: Request) -> Response:
        with session.lock:
            found = session.visits.get(request.path_params["number"])
            if found is None:
                return PlainTextResponse("There is no such stroke.\n", 404)
            strip = found.strip()
        return JSONResponse(exports.strip(strip))

    async def table(request: Request) -> Response:
        with session.lock:
            snapshot = session.visits.snapshot()
        return _download(exports.table(snapshot), "text/csv", "strokes.csv")

    async def model(request: Request) -> Response:
        # No form of another site can send this header, and no script of one without asking first.
        if request.headers.get("x-palpate") != "page":
            return JSONResponse({"text": "Only the viewer's own page may flash."}, 403)
        image = b""
        async for piece in request.stream():
            image += piece
            if len(image) > MAX_MODEL_BYTES:
                return JSONResponse({"text": "The file is too large for a model image."}, 413)
        return JSONResponse(await run_in_threadpool(commands.flash, image))

    async def socket(ws: WebSocket) -> None:
        await ws.accept()
        await PageConnection(session, commands, ws).run()

    return Starlette(
        routes=[
            Route("/", index),
            Route("/static/{name}", static),
            Route("/api/colormaps.json", maps),
            Route("/api/strokes.csv", table),
            Route("/api/stroke-{number:int}.{kind}", stroke),
            Route("/api/strip-{number:int}.json", strip),
            Route("/api/model", model, methods=["POST"]),
            WebSocketRoute("/ws", socket),
        ],
        middleware=[Middleware(Guard, token=token, loopback=loopback, once=once)],
    )


def _download(body: bytes, media_type: str, name: str, *, inline: bool = False) -> Response:
    way = "inline" if inline else "attachment"
    return Response(body, media_type=media_type, headers={"content-disposition": f'{way}; filename="{name}"'})

"""`palpate view`: the page that shows what the probe feels, or felt."""

from __future__ import annotations

import contextlib
import os
import secrets
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate.cli.ports import document_option, fat_option
from palpate.cli.real import load_model
from palpate.console import note, say
from palpate.errors import MissingExtra, PalpateError, PortAmbiguous, UsageError

if TYPE_CHECKING:
    from palpate.stroke.change import Between
    from palpate.view.refined import Sees


@click.command(
    epilog="""\b
Examples:
  palpate view --port auto              a probe on this machine
  palpate view monday.mcap              a recording, to play, pause and wind
  palpate view --port auto --host 0.0.0.0    for a tablet in the same network; the printed link holds a token
"""
)
@click.argument("recording", required=False, type=click.Path(path_type=Path))
@click.option(
    "--port", help="A device path, COM5, socket://HOST:PORT, a serial number, or auto (the default)."
)
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on; whoever opens the page needs its token.",
)
@click.option(
    "--http-port",
    type=click.IntRange(0, 65535),
    default=8765,
    show_default=True,
    envvar="PALPATE_HTTP_PORT",
    show_envvar=True,
    help="TCP port of the page; 0 takes any.",
)
@click.option(
    "--recordings",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("recordings"),
    show_default=True,
    help="Folder that the page records to and loads visits from.",
)
@document_option
@fat_option
@click.option("--data", type=click.Path(path_type=Path, dir_okay=False),
              help="Data set with lumps visited again: what visits differ by themselves.")  # fmt: skip
@click.option("--model", type=click.Path(path_type=Path), metavar="MODEL",
              help="Of --data: the model that the probe or the recording has; field by default.")  # fmt: skip
@click.option("--refine", is_flag=True, help="Fit the finite-element model to each stroke, too, meanwhile.")
@click.option("--browser/--no-browser", default=True, help="Open the page in the browser.")
def command(
    recording: Path | None,
    port: str | None,
    host: str,
    http_port: int,
    recordings: Path,
    document: Path | None,
    fat_kPa: float | None,
    data: Path | None,
    model: Path | None,
    refine: bool,
    browser: bool,
) -> None:
    """Watch a probe, or a recording, in the browser.

    The page shows the pressure image, the stroke's tactile map with its fit, displacement and force, and
    after each stroke the estimate with its intervals. It keeps a history, says how well strokes repeat, and
    whether a lump has changed between two visits. Ctrl-C ends it; a running recording is closed properly.
    """
    if recording is not None and port is not None:
        raise UsageError("say either --port PORT for a probe or the FILE.mcap of a recording, not both")
    if model is not None and data is None:
        raise UsageError("--model goes with --data; the page shows what the probe's own model says")
    try:
        from palpate.view.serve import Viewer
    except ModuleNotFoundError as error:
        raise MissingExtra(error.name or "starlette", "view", "the viewer") from error
    from palpate.stroke.read import load_strokes
    from palpate.view.live import LiveSource
    from palpate.view.replay import ReplaySource

    if refine:
        from palpate.view.refined import refining_live, refining_recorded

    between = _between(data, model or Path("field"))
    spec = None if document is None else load_model(document)
    source: LiveSource | ReplaySource
    beside: AbstractContextManager[Sees | None] = nullcontext()
    if recording is not None:
        if recording.suffix != ".mcap":
            raise UsageError(f"{recording} is not a recording: its name should end in .mcap")
        source, mode = ReplaySource(recording, spec), "replay"
        if refine:
            beside = refining_recorded(recording)
    else:
        source = live = LiveSource(port or "auto", spec)
        mode = "live"
        _check(port or "auto")
        if refine:
            beside = refining_live(port or "auto", lambda: live.calibration, lambda: live.recorded_to)

    def ready(url: str) -> None:
        say(f"Palpate is at {url}  (Ctrl-C ends it)")

    with beside as sees:
        try:
            viewer = Viewer(
                source,
                mode=mode,
                host=host,
                port=http_port,
                recordings=recordings,
                load_strokes=partial(load_strokes, document=spec),
                token=_kept_token(),
                fat_kPa=fat_kPa,
                between=between,
                beside=sees,
            )
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise PalpateError(
                f"cannot listen on {host} port {http_port}: {reason}; try another --http-port"
            ) from error
        viewer.run(open_browser=browser, on_ready=ready)


def _between(data: Path | None, model: Path) -> dict[str, Between]:
    """What visits differ by, from a data set's lumps that were visited again; {} without one."""
    if data is None:
        return {}
    from palpate.comparison.between import between_visits
    from palpate.dataset import table

    return between_visits(load_model(model), table.read(data))


def _kept_token() -> str:
    """The token of this user's viewers, the same until the next login, so that an open page finds a viewer
    that was started again."""
    from palpate.link.emulated import directory, is_ours

    folder = directory()
    path = folder / "viewer-token"
    fresh = secrets.token_urlsafe(24)
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if is_ours(folder):
            with contextlib.suppress(FileExistsError):
                handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
                with os.fdopen(handle, "w") as out:
                    out.write(fresh)
            kept = path.read_text()
            if len(kept) == len(fresh) and kept.isascii() and kept.isprintable():
                return kept
    return fresh


def _check(port: str) -> None:
    """Say at once what is wrong with the port; only a wrong word ends the command, the rest may still
    come."""
    from palpate.link.devices import resolve

    try:
        resolve(port, 921_600)
    except PortAmbiguous:
        raise
    except PalpateError as error:
        note(f"{error}; the page waits for it.")

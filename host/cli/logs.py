"""`-v` and `--log-file`, of every command: what Palpate's loggers say, by Python's own logging.

Each module logs under its own name, as `palpate.link.line`; a program that uses Palpate hears `palpate`.
"""

from __future__ import annotations

import contextlib
import logging
import platform
import sys
from pathlib import Path
from typing import Any

import click

from palpate.console import note, printable
from palpate.errors import UsageError
from palpate.files import cannot_write

LOG = logging.getLogger("palpate")
_HANDLERS: list[logging.Handler] = []


class _File(logging.FileHandler):
    """A log that cannot be written says so once; the command goes on."""

    def handleError(self, record: logging.LogRecord) -> None:
        LOG.removeHandler(self)
        error = sys.exc_info()[1]
        why = str(cannot_write(Path(self.baseFilename), error)) if isinstance(error, OSError) else str(error)
        note(f"no more is logged: {why}")

    def close(self) -> None:
        with contextlib.suppress(OSError):  # what it could not write it has said
            super().close()


class _Plain(logging.Formatter):
    """What a probe or a file says reaches no terminal as a command."""

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record), lines=True)


def options(hidden: bool = False) -> list[click.Option]:
    """The two options; hidden in the help of each command, where they work as well."""
    return [
        click.Option(
            ["-v", "--verbose"], count=True, expose_value=False, is_eager=True, hidden=hidden,
            callback=_verbose, help="Log to standard error; -vv says more.",
        ),
        click.Option(
            ["--log-file"], type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", hidden=hidden,
            expose_value=False, is_eager=True, callback=_log_file,
            help="Log everything into FILE, behind what is there.",
        ),
    ]  # fmt: skip


def _verbose(_context: click.Context, _option: click.Parameter, count: int) -> None:
    if count:
        _listen(logging.StreamHandler(sys.stderr), logging.INFO if count == 1 else logging.DEBUG)


def _log_file(_context: click.Context, _option: click.Parameter, path: Path | None) -> None:
    if path is None:
        return
    try:
        handler = _File(path, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"cannot log into {path}: {(error.strerror or str(error)).lower()}") from error
    _listen(handler, logging.DEBUG)


def _listen(handler: logging.Handler, level: int) -> None:
    handler.setLevel(level)
    handler.setFormatter(_Plain("%(asctime)s %(levelname)-7s %(name)s: %(message)s"))
    LOG.addHandler(handler)
    LOG.setLevel(logging.DEBUG)
    _HANDLERS.append(handler)
    from palpate import __version__

    system = f"Python {platform.python_version()}, {platform.platform()}"
    begun = f"palpate {__version__}, {system}: {sys.argv[1:]}"
    handler.handle(logging.LogRecord(LOG.name, logging.INFO, __file__, 0, begun, None, None))


def ended(status: int, error: BaseException | None = None) -> None:
    """Log how the command ended, with an unexpected error's traceback, and close what was opened."""
    if _HANDLERS:
        known: Any = None if error is None else (type(error), error, error.__traceback__)
        LOG.debug("exit status %d", status, exc_info=known)
    for handler in _HANDLERS:
        LOG.removeHandler(handler)
        handler.close()
    _HANDLERS.clear()

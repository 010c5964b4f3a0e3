"""What commands print: one JSON document with `--json`, a table or a line for people without."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar
from unicodedata import category

import click

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

_NOT_ASCII = re.compile(r"[^\n -~]")

F = TypeVar("F", bound=Callable[..., Any])


def json_option(function: F) -> F:
    """The option `--json`, the same words everywhere; the command gets `as_json: bool`."""
    text = "Print the result as JSON, and nothing else, on standard output."
    return click.option("--json", "as_json", is_flag=True, help=text)(function)


def plain(value: Any) -> Any:
    """`value` with numpy's and our own types converted for JSON; NaN and infinity become null.

    Parameters
    ----------
    value : object
        Nested dicts, sequences, numpy arrays and scalars, bytes (as hex), paths.
    """
    if isinstance(value, bool | int | str) or value is None:
        return value
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, bytes | bytearray):
        return bytes(value).hex()
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, Iterable):
        return [plain(item) for item in value]
    return str(value)


def printable(text: str, lines: bool = False) -> str:
    """`text` with control characters written as escapes: what a device or a file says commands no terminal.

    Parameters
    ----------
    text : str
        From anywhere.
    lines : bool
        Leave line breaks and tabs as they are.
    """
    if text.isprintable():
        return text
    kept = "\n\t" if lines else ""
    return "".join(
        c if c.isprintable() or c in kept or category(c) == "Zs" else c.encode("unicode_escape").decode()
        for c in text
    )


def print_json(value: Any) -> None:
    """One JSON document on standard output: indented for a terminal, on one line for a program."""
    indent = 2 if sys.stdout.isatty() else None
    text = json.dumps(plain(value), indent=indent, allow_nan=False, ensure_ascii=False)
    sys.stdout.write(_NOT_ASCII.sub(_json_escape, text) + "\n")
    sys.stdout.flush()


def _json_escape(found: re.Match[str]) -> str:
    return found[0] if found[0].isprintable() else json.dumps(found[0])[1:-1].replace("\x7f", "\\u007f")


def console(stderr: bool = False) -> Console:
    """A rich console; anything but results (progress, hints) goes to standard error.

    Into a file or a pipe, tables are as wide as they need: nothing is cut to a terminal's 80 columns.
    """
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() or "COLUMNS" in os.environ else 160
    return Console(stderr=stderr, highlight=False, soft_wrap=True, width=width)


def say(text: str, err: bool = False) -> None:
    """A result for people, on standard output (or error)."""
    click.echo(printable(text, lines=True), err=err)


def note(text: str) -> None:
    """One line to people, on standard error, so that results can be piped."""
    say(text, err=True)


def progress(unit: str = "") -> Progress:
    """A progress bar with rate and time left, on standard error; silent where that is not a terminal."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class Rate(ProgressColumn):
        """How many a second."""

        def render(self, task: Task) -> Text:
            speed = task.finished_speed or task.speed
            return Text("" if not speed else f"{speed:.1f}/s" if speed < 100 else f"{speed:.0f}/s")

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        Rate(),
        TimeRemainingColumn(compact=True),
        console=console(stderr=True),
        disable=not sys.stderr.isatty(),
        transient=True,
    )


def table(
    columns: Iterable[str], rows: Iterable[Iterable[Any]], title: str | None = None, stderr: bool = False
) -> None:
    """A plain table on standard output (or error); the columns after the first are aligned to the right."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    shown = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left")
    for i, name in enumerate(columns):
        shown.add_column(name, justify="left" if i == 0 else "right", overflow="fold")
    for row in rows:
        cells = (cell if isinstance(cell, str) else f"{cell:g}" for cell in row)
        shown.add_row(*(Text(printable(cell, lines=True)) for cell in cells))
    console(stderr).print(shown)


@contextmanager
def showing_progress() -> Iterator[Callable[[str, int, int], None]]:
    """Progress bars for work that reports what it does, how much of it is done, and how much there is.

    Each kind of work has a bar of its own, which starts over when its count does. Where standard error is not
    a terminal there are plain lines, far apart.
    """
    if not sys.stderr.isatty():
        from palpate.progress import ProgressLines

        yield ProgressLines(note)
        return
    with progress() as bars:
        tasks: dict[str, Any] = {}

        def report(what: str, done: int, total: int) -> None:
            known = tasks.get(what)
            if known is None:
                tasks[what] = known = bars.add_task(what, total=total)
            elif done < bars.tasks[known].completed:
                bars.reset(known, total=total)
            bars.update(known, completed=done, total=total)

        yield report

"""The frame of the command line: commands imported when used, errors as one sentence, exit statuses.

Exit status: 0 done, 1 the work failed, 2 invalid arguments, 130 stopped by Ctrl-C, 143 by SIGTERM.
"""

from __future__ import annotations

import contextlib
import errno
import importlib
import os
import signal
import sys
import warnings
from typing import Any

import click

from palpate.cli import logs
from palpate.console import note, printable
from palpate.errors import PalpateError

CHAPTERS: dict[str, tuple[tuple[str, str, str], ...]] = {
    "All of it": (("demo", "palpate.cli.demo", "the whole chain, from tissue to an answer on the probe"),),
    "Tissue": (
        ("simulate", "palpate.cli.simulate", "one finite-element stroke: map, features, displacement"),
        ("sweep", "palpate.cli.sweep", "many strokes, on all cores or a cluster; goes on where it stopped"),
    ),
    "Model": (
        ("fit", "palpate.cli.fit", "fit a model to strokes; Table 1 beside the thesis"),
        ("keygen", "palpate.cli.keygen", "make a signing key"),
        ("export", "palpate.cli.export", "compile and sign the model for the probe"),
        ("compile", "palpate.cli.compile", "a regression of your own as integers for any microcontroller"),
    ),
    "Probe": (
        ("emulate", "palpate.cli.emulate", "a probe without hardware, on real MicroPython"),
        ("board", "palpate.cli.board", "the firmware for a board that you have built"),
        ("devices", "palpate.cli.devices", "ports, and the probes behind them"),
        ("flash", "palpate.cli.flash", "put a model onto a probe"),
        ("calibrate", "palpate.cli.calibrate", "zero and gain of the cells, stored on the probe"),
        ("reference", "palpate.cli.reference", "one press beside the lump, which the strokes lean on"),
        ("settings", "palpate.cli.settings", "show or change what the probe can be set to"),
        ("stream", "palpate.cli.stream", "strokes and estimates from a probe, recorded"),
        ("view", "palpate.cli.view", "watch a probe, or a recording, in the browser"),
    ),
    "Recordings": (
        ("replay", "palpate.cli.replay", "a recording through the live parser and the probe's code"),
        ("convert", "palpate.cli.convert", "a recording as Parquet, HDF5 or CSV"),
        ("refine", "palpate.cli.refine", "strokes fitted by the finite-element model itself"),
    ),
    "Real strokes": (
        ("import", "palpate.cli.import_", "frames of anybody's sensor as recordings"),
        ("characterise", "palpate.cli.characterise", "a sensor's noise, measured from recordings"),
        ("validate", "palpate.cli.validate", "how far a model can be believed on real strokes"),
        ("adapt", "palpate.cli.adapt", "a model corrected by real strokes"),
        ("compare", "palpate.cli.compare", "what has changed between two visits"),
    ),
    "This machine": (
        ("doctor", "palpate.cli.doctor", "is this machine ready, and what to do"),
        ("example", "palpate.cli.example", "example scripts, copied to where you work"),
        ("completion", "palpate.cli.completion", "let the shell complete commands"),
    ),
}
"""Chapter of `palpate --help` -> (command, its module, its one line); the module holds `command`."""


class ReaderGone(Exception):
    """The reader of our output (head, less) has closed it."""


class CommandGroup(click.Group):
    """The command group; a command's module is imported only when that command is called."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run what was asked; a reader that has gone ends it quietly."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError as error:  # click would end with 1, as if the work had failed
            raise ReaderGone from error

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Every command's name, chapter by chapter."""
        return [name for chapter in CHAPTERS.values() for name, _, _ in chapter]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of this name, whose module is imported only now; None if there is none."""
        for chapter in CHAPTERS.values():
            for name, module, _ in chapter:
                if name == cmd_name:
                    found = importlib.import_module(module).command
                    assert isinstance(found, click.Command)
                    taken = {word for option in found.params for word in option.opts}
                    found.params += [o for o in logs.options(hidden=True) if not taken & set(o.opts)]
                    return found
        return None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command meant by the first argument; of a wrong name, what it resembles is said."""
        for before, word in zip(["", *args], args):
            if before == "--port" or word.startswith("--port="):
                _take_array(word.removeprefix("--port="))
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            import difflib

            near = difflib.get_close_matches(args[0], self.list_commands(ctx), n=1) if args else []
            hint = f"did you mean {near[0]!r}?" if near else "`palpate --help` lists the commands"
            raise click.UsageError(f"there is no command {args[0]!r}; {hint}", ctx) from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Chapters in the order in which one works; nothing is imported for it."""
        for title, chapter in CHAPTERS.items():
            if chapter:
                with formatter.section(title):
                    formatter.write_dl([(name, line) for name, _, line in chapter], col_max=12)


def _take_array(port: str) -> None:
    """Of somebody's array, before the command's module imports what depends on it."""
    if ":" in port:
        from palpate.link.schemes import use_array_of

        use_array_of(port)


def exit_status(error: BaseException) -> int:
    """An error's own exit status; 2 for click's errors (invalid arguments), else 1."""
    if isinstance(error, PalpateError):
        return error.exit_status
    return 2 if isinstance(error, click.ClickException) else 1


def is_expected(error: BaseException) -> bool:
    """True for errors that we raised on purpose: they carry a sentence for the user."""
    return isinstance(error, PalpateError)


def sentence(error: BaseException) -> str:
    """One line, one sentence: what was wrong and what to do.

    Parameters
    ----------
    error : BaseException
        Whatever ended a command.
    """
    if isinstance(error, click.ClickException):
        text = error.format_message()
        context = getattr(error, "ctx", None)
        if context is not None and "--help" not in text and not text.endswith("?"):
            text = f"{text.rstrip('.')}; see `{context.command_path} --help`"
    elif is_expected(error):
        text = str(error)
    elif isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        text = "the disk is full; make room and try again: what was finished is kept"
    elif isinstance(error, OSError) and error.strerror:
        where = f"{error.filename}: " if error.filename else ""
        text = f"{where}{error.strerror.lower()}"
    elif isinstance(error, ModuleNotFoundError):
        text = f"the Python package {error.name!r} is missing; `palpate doctor` says what to install"
    elif isinstance(error, MemoryError):
        text = "the machine ran out of memory; use fewer --workers or a coarser --hx"
    else:
        text = (
            f"unexpected {type(error).__name__}: {error}; "
            "run again with PALPATE_DEBUG=1 for the traceback and report it"
        )
    return printable(" ".join(text.split())) or type(error).__name__


def _on_sigterm(signum: int, _frame: Any) -> None:
    raise SystemExit(128 + signum)


def _on_ctrl_c(_signum: int, _frame: Any) -> None:
    """From here on nothing but the sentence is printed.

    Where Ctrl-C meets something half built (an event loop, a pool of workers), the threads and finalisers of
    what is left would complain with tracebacks of their own.
    """
    import threading

    sys.unraisablehook = lambda _unraisable: None
    threading.excepthook = lambda _args: None
    warnings.simplefilter("ignore")
    raise KeyboardInterrupt


def run(cli: click.Command, args: list[str] | None = None) -> int:
    """Run the command line and turn every ending into an exit status.

    `PALPATE_DEBUG=1` shows the traceback of an error instead of its sentence.
    """
    debug = os.environ.get("PALPATE_DEBUG", "") not in ("", "0")
    if sys.stderr is None:  # closed: what is opened next would take its number, and what we say with it
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    if sys.stdout is None:
        note("palpate: standard output is closed; give it a place, as >/dev/null.")
        return 1
    with contextlib.suppress(ValueError):  # not the main thread: a test or a notebook
        signal.signal(signal.SIGTERM, _on_sigterm)  # so that files are closed as on Ctrl-C
        if not debug and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, _on_ctrl_c)
    status, error = 1, None
    try:
        status, error = _outcome(cli, args, debug)
    finally:
        logs.ended(status, error)
    return status


def _outcome(cli: click.Command, args: list[str] | None, debug: bool) -> tuple[int, BaseException | None]:
    """The exit status, and the error that ended the command, if one did."""
    try:
        result = cli.main(args=args, prog_name="palpate", standalone_mode=False)
        sys.stdout.flush()
        return (result if isinstance(result, int) else 0), None
    except click.exceptions.Exit as ending:
        return ending.exit_code, None
    except (KeyboardInterrupt, click.Abort):
        note("palpate: stopped; everything finished so far is kept.")
        return 130, None
    except (ReaderGone, BrokenPipeError):  # not an error, but Python must not complain at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0, None
    except Exception as error:
        if debug:
            import traceback

            traceback.print_exc()
            return exit_status(error), error
        text = sentence(error)
        note(f"palpate: {text}{'' if text.endswith(('.', '?', '`')) else '.'}")
        return exit_status(error), error

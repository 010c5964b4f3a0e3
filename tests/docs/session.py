"""A reader at the keyboard: a shell and a Python for each page, more terminals for what is left running."""

from __future__ import annotations

import json
import os
import re
import selectors
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from tests.docs.blocks import ROOT, Block

BIN = ROOT / ".venv" / "bin"


BLOCK_TIMEOUT_S = 900


"""Against a hang: a machine ten times slower than ours comes through."""


SAYS_SOMETHING_S = 300


_HIDDEN = (".git", ".ci", "Makefile", "out", "site", "build")


"""Not linked into a page's directory: what a block must not reach, and what it makes itself."""


_PYTHON = r"""
import json, sys
space = {"__name__": "__main__"}
for line in sys.stdin:
    order = json.loads(line)
    with open(order["path"]) as stream:
        code = compile(stream.read(), order["where"], "exec")
    exec(code, space)
    print("\n" + order["mark"] + " 0", flush=True)
"""


Left = tuple[Block, "subprocess.Popen[bytes]", Path]


"""What was left running, and where its output goes."""


class BlockFailed(AssertionError):
    """A block of the documentation does not do what it says."""


class Interpreter:
    """A process that runs one text after the other and says when each is done."""

    def __init__(self, command: list[str], directory: Path, env: dict[str, str]) -> None:
        self._process = subprocess.Popen(
            command,
            cwd=directory,
            env=env,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            bufsize=0,
            start_new_session=True,
        )
        assert self._process.stdin and self._process.stdout
        self._in, self._out = self._process.stdin, self._process.stdout
        os.set_blocking(self._out.fileno(), False)
        self._ready = selectors.DefaultSelector()
        self._ready.register(self._out, selectors.EVENT_READ)

    def run(self, order: str, mark: str, timeout_s: float) -> tuple[int, str]:
        """Send `order`, wait for `mark STATUS`; a process that ends instead gives its own status."""
        self._in.write(order.encode())
        heard, deadline = b"", time.monotonic() + timeout_s
        end = re.compile(rb"\n" + mark.encode() + rb" (\d+)\n")
        while time.monotonic() < deadline:
            if not self._ready.select(0.5):
                continue
            piece = self._out.read(65536)
            if piece == b"":
                return self._process.wait(), heard.decode(errors="replace")
            heard += piece or b""
            if done := end.search(heard):
                return int(done[1]), heard[: done.start()].decode(errors="replace")
        raise TimeoutError(heard.decode(errors="replace"))

    def close(self) -> None:
        """End it and whatever it started."""
        _end(self._process, signal.SIGTERM)
        self._ready.close()
        self._in.close()
        self._out.close()


class Session:
    """Runs a page's blocks in a directory of their own.

    Parameters
    ----------
    directory : Path
        New or copied from the page before; the tree's rooms are linked into it, so that it looks like the
        clone that the reader stands in, but for what commands write.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        (directory / ".blocks").mkdir(parents=True, exist_ok=True)
        for entry in ROOT.iterdir():
            if entry.name not in _HIDDEN and not (directory / entry.name).exists():
                (directory / entry.name).symlink_to(entry)
        run_time = directory / ".blocks" / "run"
        run_time.mkdir(mode=0o700, exist_ok=True)
        self._env = os.environ | {
            "PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}",
            "XDG_RUNTIME_DIR": str(run_time),
            "XDG_STATE_HOME": str(directory / ".state"),
            "MPLBACKEND": "Agg",
            "BROWSER": "true",
            "PALPATE_HTTP_PORT": "0",
            "COLUMNS": "110",
            "NO_COLOR": "1",
            # As in a clone, from where they are: through the links they would be compiled anew for each page.
            "PYTHONPATH": str(ROOT),
            "PYTHONSAFEPATH": "1",
        }
        self._shell: Interpreter | None = None
        self._python: Interpreter | None = None
        self._left: list[Left] = []
        self._count = 0

    def run(self, block: Block) -> str:
        """Run one block and give what it printed; `BlockFailed` where it ends otherwise than it says."""
        self._count += 1
        if block.stays:
            return self._leave_running(block)
        path = self.directory / ".blocks" / f"{self._count}.{block.runs_as}"
        path.write_text(block.text)
        expected = int(block.reason) if block.mark == "exits with" else 0
        mark = f"block-{self._count}-of-{os.getpid()}"
        try:
            if block.runs_as == "sh":
                status, said = self._run_shell(path, mark, fails=bool(expected))
            else:
                status, said = self._run_python(path, mark, block.where)
        except TimeoutError as late:
            raise BlockFailed(f"{block.where} is still running after {BLOCK_TIMEOUT_S} s\n{late}") from None
        if status != expected:
            raise BlockFailed(f"{block.where} ended with {status}, not {expected}\n{block.text}\n{said}")
        return said

    def _run_shell(self, path: Path, mark: str, fails: bool) -> tuple[int, str]:
        if self._shell is None:
            self._shell = Interpreter(["bash", "--noprofile", "--norc"], self.directory, self._env)
        strict = "set +e" if fails else "set -eo pipefail"
        order = f"{strict}\nsource {path} </dev/null\nprintf '\\n{mark} %d\\n' $?\n"
        return self._shell.run(order, mark, BLOCK_TIMEOUT_S)

    def _run_python(self, path: Path, mark: str, where: str) -> tuple[int, str]:
        if self._python is None:
            self._python = Interpreter([str(BIN / "python"), "-u", "-c", _PYTHON], self.directory, self._env)
        order = json.dumps({"path": str(path), "mark": mark, "where": where}) + "\n"
        return self._python.run(order, mark, BLOCK_TIMEOUT_S)

    def _leave_running(self, block: Block) -> str:
        """Start it and wait until it has said something, as a reader would before going on.

        In a terminal with a name, as "second terminal, leave it running", Ctrl-C ends what still runs there.
        """
        if "terminal" in block.title:
            self._ctrl_c([left for left in self._left if left[0].title == block.title])
        path = self.directory / ".blocks" / f"{self._count}.sh"
        path.write_text("set -eo pipefail\n" + block.text)
        log = path.with_suffix(".log")
        with log.open("wb") as stream:
            process = subprocess.Popen(
                ["bash", str(path)],
                cwd=self.directory,
                env=self._env | {"PYTHONUNBUFFERED": "1"},
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_hears_ctrl_c,
            )
        self._left.append((block, process, log))
        deadline = time.monotonic() + SAYS_SOMETHING_S
        while time.monotonic() < deadline:
            if process.poll() is not None:
                raise BlockFailed(f"{block.where} ended by itself\n{block.text}\n{log.read_text()}")
            if log.stat().st_size:
                return log.read_text()
            time.sleep(0.05)
        raise BlockFailed(f"{block.where} said nothing in {SAYS_SOMETHING_S} s\n{block.text}")

    def close(self) -> None:
        """Ctrl-C in every terminal; a command of ours that answers with a traceback fails the page."""
        for interpreter in (self._shell, self._python):
            if interpreter is not None:
                interpreter.close()
        self._ctrl_c(self._left[::-1])

    def _ctrl_c(self, left: list[Left]) -> None:
        complaints = []
        for block, process, log in left:
            _end(process, signal.SIGINT)
            if "palpate " in block.text and "Traceback" in log.read_text():  # others' manners are theirs
                complaints.append(f"{block.where} ended with a traceback\n{log.read_text()}")
        self._left = [one for one in self._left if one not in left]
        if complaints:
            raise BlockFailed("\n".join(complaints))


def _hears_ctrl_c() -> None:
    """The tests themselves may run where it is ignored (`nohup`, a script's background)."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def copy_files(source: Path, target: Path) -> None:
    """What a page left behind, for the page that goes on from it; links into the tree are not followed."""
    shutil.copytree(source, target, symlinks=True, ignore=shutil.ignore_patterns(".blocks"))


def _end(process: subprocess.Popen[bytes], how: signal.Signals) -> None:
    for attempt in (how, signal.SIGKILL):
        try:
            os.killpg(process.pid, attempt)
        except ProcessLookupError:
            break
        try:
            process.wait(60)
        except subprocess.TimeoutExpired:
            continue
        break
    process.wait(5)


if sys.platform == "win32":
    raise ImportError("the documentation's blocks are shell commands: run these tests on Linux or macOS")

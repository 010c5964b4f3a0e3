"""The code blocks of README.md and docs/**/*.md, and what each says about being run.

A fenced block in `sh`, `bash`, `console` or `python` is run as it stands. One line of comment above it may
say otherwise:

    <!-- not run: needs a board -->       it is not, and why; such blocks are counted
    <!-- exits with 2 -->                 it is, and must end with that status
    <!-- prints -->                       (above a `text` block) it is what the block before printed

A block whose title or text holds "leave it running" stays up in the background until the page ends. A page
that says `<!-- goes on from: tutorial/emulated.md -->` begins in the directory in which that page ended; for
one that says `<!-- beside it runs: palpate emulate ... -->` that command is started first, for a board.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
DOCS = ROOT / "docs"
RUN = {"sh": "sh", "bash": "sh", "console": "sh", "python": "python", "py": "python"}
DATA = ("text", "json", "toml", "yaml", "ini", "csv")

_FENCE = re.compile(r"^(?P<indent> *)(?P<fence>`{3,}|~{3,})\s*(?P<info>[^`]*)$")
_COMMENT = re.compile(r"^\s*<!--\s*(?P<words>.*?)\s*-->\s*$")
_MARK = re.compile(r"(?P<kind>not run|exits with|prints)(?:\s*:?\s*(?P<rest>.*))?$")
_COMMAND = re.compile(
    r"^(\$ |>>> )?(palpate|make|python3?|pip|sudo|import|from \w+ import|mpremote|npm|git) ?\b"
)


@dataclass(frozen=True)
class Block:
    """One fenced block.

    Attributes
    ----------
    page : Path
    line : int
        Of its fence, from 1.
    language, title, text : str
    mark, reason : str
        The comment above it: "not run", "exits with", "prints" or "", and its words.
    """

    page: Path
    line: int
    language: str
    title: str
    text: str
    mark: str = ""
    reason: str = ""

    @property
    def where(self) -> str:
        """`docs/page.md:12`, which editors open."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def runs_as(self) -> str:
        """`sh` or `python` where it is to be run, else ""."""
        return "" if self.mark == "not run" else RUN.get(self.language, "")

    @property
    def stays(self) -> bool:
        """True for a command in a terminal of its own that the reader leaves running."""
        return "leave it running" in self.title or "leave it running" in self.text


def pages() -> list[Path]:
    """README.md and every page of the documentation."""
    return [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]


def blocks_of(page: Path) -> list[Block]:
    """The fenced blocks of a page, in order."""
    return read_blocks(page, page.read_text(encoding="utf-8"))


def read_blocks(page: Path, text: str) -> list[Block]:
    """The fenced blocks of a page's text."""
    found: list[Block] = []
    lines = text.splitlines()
    at, mark, reason = 0, "", ""
    while at < len(lines):
        line = lines[at]
        fence, comment = _FENCE.match(line), _COMMENT.match(line)
        if fence:
            end = next(
                (k for k in range(at + 1, len(lines)) if lines[k].strip() == fence["fence"]), len(lines)
            )
            cut = len(fence["indent"])
            body = "\n".join(x[cut:] if not x[:cut].strip() else x for x in lines[at + 1 : end]) + "\n"
            language, title = _info(fence["info"])
            found.append(Block(page, at + 1, language, title, body, mark, reason))
            at, mark, reason = end, "", ""
        elif comment:
            words = _MARK.match(comment["words"])
            mark, reason = (words["kind"], words["rest"] or "") if words else ("", "")
        elif line.strip():
            mark, reason = "", ""
        at += 1
    return found


def goes_on_from(page: Path) -> Path | None:
    """The page whose files this one needs, if it says so."""
    words = re.search(r"<!--\s*goes on from:\s*(\S+)\s*-->", page.read_text(encoding="utf-8"))
    return DOCS / words[1] if words else None


def runs_beside(page: Path) -> Block | None:
    """What is left running while the page runs, if it says so."""
    words = re.search(r"<!--\s*beside it runs:\s*(.+?)\s*-->", page.read_text(encoding="utf-8"))
    return Block(page, 1, "sh", "leave it running", words[1] + "\n") if words else None


def unfenced_commands(page: Path) -> list[str]:
    """Lines of indented blocks that look like something to run: these must be fenced, so that they are."""
    found, fenced, before = [], "", ""
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        fence = _FENCE.match(line)
        if fence and not fenced:
            fenced = fence["fence"]
        elif fenced and line.strip() == fenced:
            fenced = ""
        elif not fenced and line.startswith("    ") and not before and _COMMAND.match(line.strip()):
            found.append(f"{page.relative_to(ROOT)}:{number}: {line.strip()}")
        if not line.startswith("    "):
            before = line.strip()
    return found


def _info(info: str) -> tuple[str, str]:
    """Language and title of a fence's info string: `sh title="first terminal"`, `{ .sh title="..." }`."""
    title = re.search(r"title=\"([^\"]*)\"", info)
    language = re.match(r"\{?\s*\.?([\w+-]*)", info.strip())
    return (language[1].lower() if language else ""), (title[1] if title else "")

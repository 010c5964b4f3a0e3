"""How many words of the documentation are written by hand: `python -m tests.docs.words`.

A word is what stands between spaces and holds a letter or a digit, in prose, tables and code blocks alike.
Not counted: pages that a command writes whole (each names the command under its title), tables that a command
writes (between two comments), comments, and the changelog.
"""

from __future__ import annotations

import re
from pathlib import Path

from tests.docs.blocks import ROOT, pages

MOST = 40_000

_PAGE = re.compile(r"(?m)^(\*|<!-- )(Written by `|python .* writes this page)")
_TABLE = re.compile(
    r"<!-- begin (?P<name>\w+):.*?<!-- end (?P=name) -->|<!-- (?!fields|prints)[a-z ]+ -->.*?<!-- / -->",
    re.DOTALL,
)
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


def written_by_a_command(text: str) -> bool:
    """True for a page that no hand writes."""
    return bool(_PAGE.search(text))


def by_hand(text: str) -> int:
    """Words of a page that somebody has written."""
    if written_by_a_command(text):
        return 0
    return sum(any(map(str.isalnum, word)) for word in _COMMENT.sub("", _TABLE.sub("", text)).split())


def count() -> dict[Path, int]:
    """Words of README.md, CONTRIBUTING.md, SECURITY.md and every page of docs/."""
    every = [*pages(), ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md"]
    return {page.relative_to(ROOT): by_hand(page.read_text("utf-8")) for page in every}


if __name__ == "__main__":
    found = count()
    for page, words in sorted(found.items(), key=lambda item: item[1]):
        print(f"{words:6,}  {page}" if words else f"        {page}: a command writes it")
    print(f"{sum(found.values()):6,}  words by hand; at most {MOST:,}")

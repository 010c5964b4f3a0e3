"""docs/reference/help.md from the commands' own `--help`: python -m tests.docs.help_page [FILE]"""

import sys
from pathlib import Path

from click.testing import CliRunner

from palpate.cli import cli
from palpate.cli.runner import CHAPTERS
from tests.docs.blocks import DOCS

PAGE = DOCS / "reference" / "help.md"
WIDTH = 110
COMMANDS = [name for chapter in CHAPTERS.values() for name, _, _ in chapter]

HEAD = """# Help texts

What `palpate --help` and `palpate COMMAND --help` print, word for word. [Commands](../commands.md) tells
when to use which.

<!-- Written by `python -m tests.docs.help_page`; a test holds it equal to the commands. -->
"""


def help_of(*words: str) -> str:
    """What `palpate WORDS --help` prints."""
    done = CliRunner().invoke(cli, [*words, "--help"], prog_name="palpate", terminal_width=WIDTH)
    assert done.exit_code == 0, done.output
    return "\n".join(line.rstrip() for line in done.output.splitlines())


def render() -> str:
    """The page."""
    sections = [("palpate", help_of())] + [(name, help_of(name)) for name in COMMANDS]
    return HEAD + "".join(f"\n## {name}\n\n```text\n{text}\n```\n" for name, text in sections)


if __name__ == "__main__":
    (Path(sys.argv[1]) if sys.argv[1:] else PAGE).write_text(render(), encoding="utf-8")

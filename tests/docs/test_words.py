"""The documentation is short enough to be read, and its length is counted honestly."""

import subprocess
import sys

from tests.docs.blocks import ROOT
from tests.docs.words import MOST, by_hand, count


def test_what_is_written_by_hand_can_be_read():
    words = count()
    longest = sorted(words, key=words.get)[-3:]
    assert sum(words.values()) <= MOST, f"shorten, say {', '.join(map(str, longest))}"


def test_prose_tables_and_code_count_and_what_commands_write_does_not():
    page = "# A title\n\n| one | 2 |\n|---|---|\n\n```sh\npalpate demo\n```\n"
    assert by_hand(page) == 7
    assert by_hand(page + "\n<!-- not run: needs a board -->\nand - more") == 9
    assert by_hand(page + "<!-- times -->\n\n| three |\n\n<!-- / -->\n") == 7
    assert by_hand(page + "<!-- fields: stroke -->\n\n| three |\n\n<!-- / -->\n") == 8
    assert by_hand("*Written by `python docs/fill.py`.*\n" + page) == 0


def test_pages_that_count_nothing_name_a_command_that_is_there():
    for page in (page for page, words in count().items() if not words):
        assert (
            "python docs/fill_" in (text := (ROOT / page).read_text("utf-8"))
            or "tests.docs.help_page" in text
        )


def test_the_number_is_printed():
    done = subprocess.run(
        [sys.executable, "-m", "tests.docs.words"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert f"{sum(count().values()):,}  words by hand" in done.stdout

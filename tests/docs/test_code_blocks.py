"""Every code block in README.md and docs/ runs, or says in the page's source why it cannot."""

import json
import tomllib

import pytest

from tests.docs.alike import differs
from tests.docs.blocks import DATA, ROOT, RUN, blocks_of, pages, read_blocks, unfenced_commands
from tests.docs.session import BlockFailed, Session

REASONS = (
    "needs a board",
    "needs a cluster",
    "needs the registry",
    "installs packages",
    "takes minutes",
    "minutes",
    "fifteen minutes",
    "the whole page is run by",
    "opens a browser",
    "the tests run it",
    "not for this machine",
)
"""Why a block may stay unrun; a reason begins with one of these."""

NAMES = [str(page.relative_to(ROOT)) for page in pages()]


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", [n for n in NAMES if any(b.runs_as for b in blocks_of(ROOT / n))])
def test_a_page_does_what_it_says(name, run_page):
    run_page(ROOT / name)


@pytest.mark.parametrize("name", NAMES)
def test_no_block_is_left_out_without_a_word(name):
    """Unmarked blocks that are not run: none. Blocks in unknown languages, commands outside a fence: none."""
    left_out = [
        f"{b.where}: language {b.language!r}"
        for b in blocks_of(ROOT / name)
        if not b.runs_as and b.mark != "not run" and b.language not in DATA
    ]
    assert not left_out, "\n".join(left_out)
    assert not unfenced_commands(ROOT / name), "fence these, so that they are run"


@pytest.mark.parametrize("name", NAMES)
def test_a_block_that_is_not_run_says_why(name):
    marked = [b for b in blocks_of(ROOT / name) if b.mark == "not run"]
    vague = [f"{b.where}: {b.reason!r}" for b in marked if not b.reason.startswith(REASONS)]
    assert not vague, f"say one of {REASONS}:\n" + "\n".join(vague)


@pytest.mark.parametrize("name", NAMES)
def test_data_in_the_documentation_can_be_read(name):
    for block in blocks_of(ROOT / name):
        if block.language == "json":
            json.loads(block.text)
        elif block.language == "toml":
            tomllib.loads(block.text)


def test_most_blocks_run():
    """The marks are exceptions: boards, clusters, package managers. Their number is printed."""
    every = [b for name in NAMES for b in blocks_of(ROOT / name) if b.language in RUN]
    unrun = [b for b in every if not b.runs_as]
    print(f"{len(every)} blocks, {len(every) - len(unrun)} run, {len(unrun)} marked as not run:")
    for block in unrun:
        print(f"  {block.where}: {block.reason}")
    assert len(unrun) < 0.4 * len(every)


def test_the_runner_notices_what_is_wrong(tmp_path):
    """A runner that passes everything would pass a broken page too."""
    page = ROOT / "README.md"
    text = (
        "```sh\nfalse | cat; x=3\n```\n```sh\ntest $x = 3; cd /; pwd\n```\n```python\na = 2\n```\n"
        "```python\nprint(a + 1)\n```\n<!-- exits with 2 -->\n```sh\nls /nowhere\n```\n"
        "<!-- not run: needs a board -->\n```sh\nfalse\n```\n```sh\nfalse\n```\n"
    )
    first, second, third, fourth, fails, board, wrong = read_blocks(page, text)
    session = Session(tmp_path / "palpate")
    try:
        with pytest.raises(BlockFailed, match=r"README.md:1 ended with 1"):
            session.run(first)
    finally:
        session.close()
    session = Session(tmp_path / "again")
    try:
        session.run(read_blocks(page, "```sh\nx=3\n```")[0])
        assert session.run(second).strip() == "/", "a page's shell keeps its variables and place"
        session.run(third)
        assert session.run(fourth).strip() == "3", "a page's Python keeps its names"
        assert "nowhere" in session.run(fails)
        assert board.runs_as == ""
        with pytest.raises(BlockFailed, match="ended with 1, not 0"):
            session.run(wrong)
    finally:
        session.close()


def test_shown_output_is_compared():
    printed = "base 4.02 kPa\nother\nfound in 0.31 s\n"
    assert differs("base 4.0 kPa\n...\nfound in ... s", printed) == ""
    assert differs("base 4.5 kPa", printed) == "base 4.5 kPa"
    assert differs("found in ... s\nbase 4.0 kPa", printed) == "base 4.0 kPa", "order matters"

"""Pages of the documentation run once a session; those that go on from another find its files."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.docs.alike import differs
from tests.docs.blocks import DOCS, ROOT, blocks_of, goes_on_from, runs_beside
from tests.docs.session import BlockFailed, Session, copy_files

TUTORIAL = DOCS / "tutorial" / "emulated.md"
"""Simulates the thesis' strokes; other pages find them there, as a reader's sweep would."""
THESIS_STROKES = ROOT / "tests" / "host" / "report" / "data"


@pytest.fixture(scope="session")
def run_page(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path], Path]:
    """Runs a page's blocks and gives the directory in which it ended; a page is run once."""
    done: dict[Path, Path | BaseException] = {}

    def run(page: Path) -> Path:
        if page not in done:
            try:
                done[page] = _run(page, tmp_path_factory.mktemp(page.stem))
            except BaseException as error:
                done[page] = error
        result = done[page]
        if isinstance(result, BaseException):
            raise result
        return result

    def _run(page: Path, place: Path) -> Path:
        directory = place / "palpate"
        before = goes_on_from(page)
        if before is not None:
            copy_files(run(before), directory)
        elif page != TUTORIAL and "out/thesis" in page.read_text(encoding="utf-8"):
            copy_files(THESIS_STROKES, directory / "out" / "thesis")
        session = Session(directory)
        printed = ""
        try:
            if beside := runs_beside(page):
                session.run(beside)
            for block in blocks_of(page):
                if block.runs_as:
                    printed = session.run(block)
                elif block.mark == "prints" and (line := differs(block.text, printed)):
                    raise BlockFailed(f"{block.where} shows\n{line}\nbut what was printed is\n{printed}")
        finally:
            session.close()
        return directory

    return run

"""What `make test` gives to one worker, and what it begins with."""

import pytest

from tests import workers
from tests.docs.blocks import ROOT

PAGE = "tests/docs/test_code_blocks.py::test_a_page_does_what_it_says[{}]"


def test_what_is_said_to_take_longest_exists():
    assert [name for name in workers.LONGEST if not (ROOT / name).is_file()] == []


@pytest.mark.parametrize(
    ("test", "scope"),
    [
        (PAGE.format("README.md"), "README.md"),
        (PAGE.format("docs/viewer.md"), "docs/tutorial/emulated.md"),
        ("tests/docs/test_code_blocks.py::test_most_blocks_run", "tests/docs/test_code_blocks.py"),
        ("tests/sim/probe/test_rp2040_start.py::test_a_start_that_hangs_is_begun_again", workers.BOARD),
        ("tests/test_demo.py::test_the_estimate_is_near_the_truth", "tests/test_demo.py"),
    ],
)
def test_a_page_goes_with_those_that_go_on_from_it_and_a_test_with_its_file(test, scope):
    assert workers.scope(test) == scope

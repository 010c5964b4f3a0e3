"""What is done to a copy is told, and the board itself never hears of it."""

import os

import pytest

from palpate.sim.probe.rp2040 import flash
from tests.sim.probe.board_bench import Board
from tests.sim.probe.board_copies import CopyFailed, in_a_copy


def test_what_a_copy_does_stays_in_it_and_its_answer_comes_whole():
    held = [1, 2]

    def work():
        held.append(3)
        return os.getpid(), bytes(1 << 20), held

    number, much, theirs = in_a_copy(work)
    assert number != os.getpid() and len(much) == 1 << 20
    assert (theirs, held) == ([1, 2, 3], [1, 2])


def test_an_error_in_a_copy_and_one_that_ends_are_told():
    with pytest.raises(CopyFailed, match="there is none"):
        in_a_copy(lambda: {}["there is none"])
    with pytest.raises(CopyFailed, match="without a word"):
        in_a_copy(lambda: os._exit(3))


@pytest.mark.board
@pytest.mark.timeout(3600)
def test_a_copy_of_a_board_goes_on_from_where_it_was_and_so_does_the_board():
    """Variables, files, processor and flash chip."""
    board = Board(blocks=flash.image({}))
    board.chip.run(lambda: board.chip.connected)
    board.chip.execute("x = 6")
    on = "import os\nx += 1\nwith open('kept', 'w') as file: file.write(str(x))\nprint(x, os.listdir())"
    assert [in_a_copy(lambda: board.chip.execute(on)) for _ in range(3)] == ["7 ['kept']\n"] * 3
    assert board.chip.execute("import os\nprint(x, os.listdir())") == "6 []\n"

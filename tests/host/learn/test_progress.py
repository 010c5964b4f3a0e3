"""Progress into files and pipes: plain lines, far apart, and nothing of work that is soon done."""

from palpate.console import showing_progress
from palpate.progress import ProgressLines


def test_a_line_is_written_when_the_last_one_is_long_enough_ago():
    said: list[str] = []
    now = iter([0.0, 1.0, 14.9, 15.0, 29.0, 31.0])
    progress = ProgressLines(said.append, seconds=15.0, clock=lambda: next(now))
    for done in range(1, 6):
        progress("lumps", done, 5)
    assert said == ["lumps: 3 of 5", "lumps: 5 of 5"]


def test_a_command_whose_errors_go_to_a_file_writes_lines_and_no_bars(capfd):
    with showing_progress() as progress:
        progress("lumps", 1, 5)
        assert isinstance(progress, ProgressLines)
        progress._last -= 3600.0
        progress("lumps", 2, 5)
    assert capfd.readouterr().err == "lumps: 2 of 5\n"

"""A field more in the frame and a number more on the card are a line each, as architecture.md says."""

import json
import re

import pytest

from tests.test_another_output import copied, run

METHOD = """
    def temperature_mC(self):
        return 36600
"""
ROW = """    CardRow(
        "volume_cm3",
        "Volume",
        "cm3",
        lambda said, told: tuple(v**3 / 1910 for v in said.span("d_mm")),
    ),
"""


def replaced(path, pattern, by):
    text, n = re.subn(pattern, lambda _: by, path.read_text(), count=1, flags=re.MULTILINE)
    assert n == 1, path
    path.write_text(text)


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    home = copied(tmp_path_factory.mktemp("another") / "home")
    replaced(home / "firmware_py" / "tables.py", r"^FRAME_MORE.*$", 'FRAME_MORE = ("temperature_mC",)')
    board = home / "palpate" / "sim" / "probe" / "device" / "emulated_board.py"
    replaced(board, r"^    def start_scan", f"{METHOD.lstrip(chr(10))}\n    def start_scan")
    replaced(
        home / "palpate" / "answer" / "card.py", r'^    _across\("width_mm"', f'{ROW}    _across("width_mm"'
    )
    return json.loads(run(home, "tests.another_field", str(home)).splitlines()[-1])


def test_a_field_more_in_the_frame_reaches_client_recording_and_table(said):
    frame = said["frame"]
    assert frame["live"] == [[36600]] * 3 and frame["replayed"] == [36600]
    assert frame["motion"] == 36600 and frame["table"] == "36600"


def test_a_number_more_on_the_card_reaches_the_page_and_the_table_that_it_gives_away(said):
    card = said["card"]
    (row,) = (row for row in card["card"] if row["key"] == "volume_cm3")
    assert (row["label"], row["unit"], row["value"]) == ("Volume", "cm3", pytest.approx(0.125 / 1910))
    assert float(card["taken"]["volume_cm3"]) == pytest.approx(row["value"], rel=1e-4)

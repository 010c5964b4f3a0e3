"""The rooms on the page and in its picture are those that the imports make."""

import re

from tests.docs.blocks import DOCS
from tests.rooms import FLOOR, FLOORS, PICTURE, drawing


def test_the_picture_has_the_arrows_of_today():
    assert PICTURE.read_text(encoding="utf-8") == drawing(), "python -m tests.rooms draws it again"


def test_the_page_names_every_room_on_its_floor():
    text = (DOCS / "architecture.md").read_text(encoding="utf-8")
    told, floor = {}, 0
    for number, rooms in re.findall(r"^\| (\d?) ?\| ((?:`[\w.]+`(?:, )?)+) \|", text, re.MULTILINE):
        floor = int(number or floor)
        told |= dict.fromkeys(re.findall(r"`([\w.]+)`", rooms), floor)
    assert told == FLOOR
    assert f"{len(FLOOR)} rooms on {len(FLOORS)} floors, no arrow upward" in text

"""The board's firmware under names that MicroPython holds in its flash anyhow: the same program, smaller."""

import ast

import pytest

from palpate.sim.probe.rp2040.names import borrowed
from palpate.sim.probe.rp2040.rom_names import NAMES
from tests.sim.probe import board_bench

MODULES = {
    "store.py": "class Kept:\n    def put_away(self, what_it_is, times_over=1):\n"
    "        self.put_away_last = what_it_is\n        return what_it_is * times_over\n",
    "user.py": "from firmware_py import store\n\n\ndef twice(what_it_is):\n"
    "    read = store.Kept()\n    return read.put_away(what_it_is, times_over=2) + read.put_away_last\n",
}


def test_every_own_name_is_exchanged_for_one_of_the_ports_and_modules_keep_theirs():
    found = borrowed(MODULES, {"twice"})
    words = {
        word
        for text in found.values()
        for node in ast.walk(ast.parse(text))
        for word in (getattr(node, "id", ""), getattr(node, "attr", ""), getattr(node, "arg", ""))
    }
    assert set(found) == set(MODULES)
    assert "from firmware_py import store" in found["user.py"]
    assert "def twice(" in found["user.py"]
    assert not words & {"Kept", "put_away", "put_away_last", "what_it_is", "times_over"}
    assert {"read", "self", "store"} <= words


def test_the_program_is_the_same_under_its_borrowed_names():
    found = borrowed(MODULES, {"twice"})
    space: dict = {}
    exec(found["store.py"], space)
    (kept,) = [thing for thing in space.values() if isinstance(thing, type)]
    user = found["user.py"].replace("from firmware_py import store\n", "")
    scope = {"store": type("store", (), {kept.__name__: kept})}
    exec(user, scope)
    assert scope["twice"](3) == 9


def test_instructions_of_inline_assembler_keep_their_names():
    """Elsewhere the firmware has functions of its own that are called `add` and `data`."""
    assembler = "import micropython\n\n\n@micropython.asm_thumb\ndef sum_of(r0, r1):\n    addl(r0, r1)\n"
    other = "def addl(one_number):\n    return one_number\n"
    found = borrowed({"asm.py": assembler, "other.py": other})
    assert "(r0, r1):\n    addl(r0, r1)" in found["asm.py"]
    assert "sum_of" not in found["asm.py"]
    assert "def addl(" in found["other.py"]


@pytest.mark.board
def test_every_name_of_the_list_lies_in_the_ports_flash():
    path = board_bench.uf2()
    assert path
    blocks = path.read_bytes()
    flash = b"".join(blocks[at + 32 : at + 32 + 256] for at in range(0, len(blocks), 512))
    assert not [name for name in NAMES if name.encode() + b"\0" not in flash], (
        "as a string, or as the end of one"
    )

"""The one file that holds the board's modules, as the board's own `main.py` finds them in it."""

import binascii
import io
import struct
import zlib

import pytest

from firmware_py import messages
from palpate.sim.probe.rp2040.board_files import packed
from palpate.sim.probe.rp2040.main_text import main_text

FILES = {"wire.py": b"w" * 10, "boards/scan.py": b"s" * 300, "boards/__init__.py": b"", "scan.py": b"x"}


@pytest.fixture
def board_pack(tmp_path):
    """Opens a pack by the class that `main.py` has."""
    text = main_text(False, messages.TYPE["log"])
    space = {"binascii": binascii, "io": io, "struct": struct}
    exec(text[text.index("class Pack") : text.index("def tell")], space)

    def open_pack(data):
        (tmp_path / "firmware.pack").write_bytes(data)
        return space["Pack"](str(tmp_path / "firmware.pack"))

    return open_pack


def test_every_module_is_found_and_nothing_else(board_pack):
    """`import time` looked for /firmware/time.mpy, and was given whatever stood behind two zeros."""
    pack = board_pack(packed(FILES))
    for name, data in FILES.items():
        path = f"firmware_py/{name.removesuffix('.py')}.mpy"
        assert pack.open("/" + path, "rb").read() == data
        assert pack.stat(path)[6] == len(data)
    for folder in ("firmware_py", "/firmware_py/boards"):
        assert pack.stat(folder)[0] == 0x4000
    padded = board_pack(packed({"a.py": b"x" * 10, "b.py": b"y"}))  # a size of 10 looks like a line feed
    for path in ("time.mpy", "machine.mpy", "firmware_py.mpy", "firmware_py/wire.py", "firmware_py/none.mpy"):
        for one in (pack, padded):
            with pytest.raises(OSError):
                one.stat(path)


def test_a_pack_with_one_other_bit_is_refused(board_pack):
    data = packed(FILES)
    for place in range(len(data)):
        damaged = bytearray(data)
        damaged[place] ^= 1 << place % 8
        with pytest.raises(ValueError, match="is damaged: copy it onto the probe again"):
            board_pack(bytes(damaged))
    assert zlib.crc32(data[4:]).to_bytes(4, "little") == data[:4]

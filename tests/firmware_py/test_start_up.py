"""What a board does with machine code as it starts: it takes what gives the same numbers, and says so."""

import builtins
import importlib
import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from firmware_py import cobs, crc
from firmware_py.boards import machine_code as plain_machine_code
from firmware_py.boards import scan_order
from tests.firmware_py import twins
from tests.micropython import run_micropython
from tests.sim.probe.machine_code import MachineCode

MODULES = {
    "firmware_py.hot_viper": twins.HOT,
    "firmware_py.stroke_viper": twins.STROKE,
    "firmware_py.evaluator_viper": twins.EVALUATOR,
    "firmware_py.boards.fast_link": twins.LINK,
    "firmware_py.boards.fast_scan": twins.SCAN,
}
PARTS = (*plain_machine_code.PARTS, ("scan", plain_machine_code.scan_part))


def loops():
    """The loops that are in use."""
    sources = (twins.HOT, twins.STROKE, twins.EVALUATOR)
    places = [place for source in sources for place in twins.places(source).values()]
    modules = {module: importlib.import_module(f"firmware_py.{module}") for module, _ in places}
    return [getattr(modules[module], name) for module, name in places] + [
        crc.append,
        crc.append_plain,
        crc.check,
        crc.check_plain,
        cobs.encode,
        scan_order.pack,
    ]


@pytest.fixture
def clean(monkeypatch):
    """Afterwards all loops are the plain ones again, and no twin is left imported."""
    for loop in loops():
        monkeypatch.setattr(sys.modules[loop.__module__], loop.__name__, loop)
    for table in ("_LOW", "_HIGH"):
        monkeypatch.setattr(crc, table, getattr(crc, table))
    yield
    for name in MODULES:
        if sys.modules.pop(name, None):
            parent, _, last = name.rpartition(".")
            if parent in sys.modules:
                delattr(sys.modules[parent], last)


@contextmanager
def a_board_with_a_compiler(architecture: str, sources=MODULES, frozen=False) -> Iterator[None]:
    """`import` of a twin gives its functions as machine code on an emulated processor."""
    codes = {name: MachineCode(source, architecture, frozen=frozen) for name, source in sources.items()}
    micropython = types.ModuleType("micropython")
    micropython.viper = lambda f: codes[f.__module__][f.__name__]  # type: ignore[attr-defined]
    pointers = ("ptr8", "ptr16", "ptr32")
    for name in pointers:
        setattr(builtins, name, int)
    sys.modules["micropython"] = micropython
    try:
        yield
    finally:
        del sys.modules["micropython"]
        for name in pointers:
            delattr(builtins, name)


def machine_code():
    return importlib.import_module("firmware_py.boards.machine_code")


@pytest.mark.parametrize("architecture", ["armv6m", "armv7emsp"])
@pytest.mark.parametrize("frozen", [False, True])
def test_a_board_with_a_compiler_runs_machine_code(clean, architecture, frozen):
    """Frozen too: two loops held a number of 17 bits, which was read from beside its place in the code."""
    before = loops()
    with a_board_with_a_compiler(architecture, frozen=frozen):
        assert machine_code().install(PARTS) == "machine code: link, frames, model, stroke, scan"
    after = loops()
    assert not any(new is old for new, old in zip(after, before, strict=True))


def test_a_port_without_one_keeps_the_plain_loops(clean):
    before = loops()
    said = machine_code().install()
    assert said.startswith("machine code: none; the rest in plain loops (ModuleNotFoundError")
    assert loops() == before
    script = """
from firmware_py import bins, polynomial, cobs
from firmware_py.boards import machine_code
before = bins.put_cells, polynomial.nested, cobs.encode
print(machine_code.install())
print(before == (bins.put_cells, polynomial.nested, cobs.encode))
"""
    said = run_micropython(script).splitlines()
    assert said[0].startswith("machine code: none; the rest in plain loops (SyntaxError")
    assert said[1] == "True"


@pytest.mark.parametrize(
    ("module", "right", "wrong", "left"),
    [
        ("firmware_py.hot_viper", "b >> 4 | packed", "b >> 5 | packed", "link, model, stroke"),
        ("firmware_py.hot_viper", "* gain[i] >> 9", "* gain[i] >> 8", "link, model, stroke"),
        ("firmware_py.hot_viper", "s = (s << 2)", "s = (s << 1)", "link, model, stroke"),
        ("firmware_py.hot_viper", "(4096 - v) * level[k]", "(4095 - v) * level[k]", "link, model, stroke"),
        ("firmware_py.stroke_viper", "up -= left", "up += left", "link, frames, model"),
        ("firmware_py.stroke_viper", "v >>= down", "v >>= down + 1", "link, frames, model"),
        ("firmware_py.stroke_viper", "v = 1 - top", "v = 0 - top", "link, frames, model"),
        ("firmware_py.stroke_viper", "k1 += k", "k1 += 1", "link, frames, model"),
        ("firmware_py.stroke_viper", "(maps[j] >> 4)", "(maps[j] >> 5)", "link, frames, model"),
        ("firmware_py.stroke_viper", "(q >> 1) + (", "(q >> 2) + (", "link, frames, model"),
        ("firmware_py.stroke_viper", "be += b * e", "be += b * z", "link, frames, model"),
        ("firmware_py.stroke_viper", "tilt += (u - v)", "tilt += (u + v)", "link, frames, model"),
        ("firmware_py.evaluator_viper", "((d[w] ^ 0x8000) - 0x8000)", "d[w]", "link, frames, stroke"),
        ("firmware_py.evaluator_viper", ">> (4 * j)) & 15", ">> (4 * j)) & 14", "link, frames, stroke"),
        ("firmware_py.evaluator_viper", "a * (v & 16383)", "a * (v & 16382)", "link, frames, stroke"),
        ("firmware_py.boards.fast_link", "code == 255", "code == 254", "frames, model, stroke"),
    ],
)
def test_machine_code_that_gives_other_numbers_is_not_used(clean, tmp_path, module, right, wrong, left):
    text = MODULES[module].read_text()
    assert right in text
    broken = tmp_path / "broken.py"
    broken.write_text(text.replace(right, wrong))
    with a_board_with_a_compiler("armv6m", {**MODULES, module: broken}):
        said = machine_code().install()
    assert said.startswith(f"machine code: {left}; the rest in plain loops (")

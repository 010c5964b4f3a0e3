"""The page on building the probe shows what its command draws and prints."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import re
from pathlib import Path

import pytest

from palpate.link.transport import open_transport

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "howto" / "build-the-probe.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def drawing():
    spec = importlib.util.spec_from_file_location("draw_probe", DOCS / "draw_probe.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_schematic_is_the_one_that_the_command_draws(drawing, tmp_path):
    drawing.schematic(tmp_path / "schematic.svg")
    assert (tmp_path / "schematic.svg").read_bytes() == (DOCS / "figures" / "schematic.svg").read_bytes()


@pytest.mark.parametrize("name", ["crosstalk", "face"])
def test_the_tables_are_those_that_the_command_prints(name, drawing):
    rows = ["| " + " | ".join(row) + " |" for row in getattr(drawing, name)()]
    assert "\n".join(rows) in PAGE


def test_every_pin_of_the_schematic_is_in_the_table(drawing):
    drawn = (DOCS / "figures" / "schematic.svg").read_text(encoding="utf-8")
    pins = {int(n) for n in re.findall(r"GP(\d+)", drawn)}
    table = "\n".join(line for line in PAGE.splitlines() if line.startswith("| GP"))
    assert pins and pins <= {int(n) for n in re.findall(r"GP(\d+)", table)}


def test_the_firmware_takes_wheel_potentiometer_bridge_and_pins_as_the_page_gives_them():
    source = (DOCS.parent / "firmware_py" / "boards" / "rp2_reference.py").read_text(encoding="utf-8")
    numbers = {
        node.targets[0].id: ast.literal_eval(node.value)
        for node in ast.parse(source).body
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant | ast.Tuple)
    }
    cycles, wheel_mm = map(int, re.search(r"encoder, (\d+) cycles a turn, .* of (\d+) mm", PAGE).groups())
    over, under = numbers["ENCODER_UM"]
    assert over / under == wheel_mm * 1000 / (4 * cycles)
    travel_mm = int(re.search(r"potentiometer, (\d+) mm", PAGE)[1])
    assert numbers["DISPLACEMENT_UM"] == 1000 * travel_mm
    baud = int(re.search(r"bridge for ([\d,]+) baud", PAGE)[1].replace(",", ""))
    assert numbers["UART_BAUD"] == baud == inspect.signature(open_transport).parameters["baud"].default
    pins = [numbers[name] for name in ("DIN_PIN", "DOUT_PIN", "SELECT_PIN")]
    assert "| GP{}, GP{}, GP{}, GP{} | MCP3204: DIN, DOUT, CS, CLK |".format(*pins, pins[2] + 1) in PAGE
    assert "| GP{}, GP{} | encoder A, B".format(*numbers["ENCODER_PINS"]) in PAGE

"""The drawings of docs/howto/build-the-probe.md, and its tables: `python docs/draw_probe.py`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import schemdraw
import schemdraw.elements as elm

from firmware_py import geometry
from palpate.console import table
from palpate.sim.tissue import Case, simulate
from palpate.sim.tissue.probe_shape import ProbeShape
from tests.sim.probe.readout import FLOATING, FULL_SCALE_KPA, REFERENCE, errors

FIGURES = Path(__file__).parent / "figures"
LUMP = "d10h08e10f10"
CALIBRATED_KPA = 5.0
FILMS_OHM = (2e3, 10e3, 50e3)


def crosstalk() -> list[list[str]]:
    """Circuit, film, feedback, and rms and largest error of a cell as a share of the image's peak."""
    stroke = simulate(Case.from_code(LUMP))
    over = int(np.argmin(np.abs(stroke.positions_mm)))
    image = np.repeat(stroke.images_kPa[over][:, None], geometry.COLUMNS, axis=1)
    rows = []
    for name, readout in (("columns float", FLOATING), ("columns held", REFERENCE)):
        for film_ohm in FILMS_OHM:
            off = errors(readout, image, film_ohm, CALIBRATED_KPA) / image.max()
            shares = [f"{100 * value:.2f} %" for value in (np.sqrt(np.mean(off**2)), np.abs(off).max())]
            ohms = [f"{ohm / 1e3:.0f} kOhm" for ohm in (film_ohm, readout.feedback_ohm(film_ohm))]
            rows.append([name, *ohms, *shares])
    return rows


def face() -> list[list[str]]:
    """Height of the face over its lowest point, mm, along and across the stroke."""
    case = Case.from_code(LUMP)
    along = ProbeShape(case.probe_radius_mm, case.face_half_mm, case.fillet_per_mm2)
    across = ProbeShape(case.across_radius_mm, case.across_half_mm, case.across_fillet_per_mm2)
    places = np.array([0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 11.0, 12.0, 16.0, 19.5])
    heights = zip(places, along.height(places)[0], across.height(places)[0], strict=True)
    return [[f"{s:g}", f"{a:.2f}", f"{b:.2f}"] for s, a, b in heights]


def schematic(path: Path) -> None:
    """The way of one cell's current, from its row to the converter, as SVG."""
    schemdraw.use("svg")
    schemdraw.svgconfig.text = "text"
    with schemdraw.Drawing(show=False, file=str(path)) as d:
        d.config(fontsize=11, unit=2.0, font="sans-serif", bgcolor="white")
        column = _cell(d)
        output = _amplifier(d, column)
        _converter(d, output)
        _reference(d)


def _cell(d: schemdraw.Drawing) -> tuple[float, float]:
    pins = {"address": ("A0-A2, EN", "left"), "common": ("D", "bottom"), "row": ("S1-S8", "right")}
    switch = _multiplexer(pins, width=4.4)
    d += switch.label("TMUX1208, 1 of 2", loc="top").at((0, 0)).anchor("row")
    d += elm.Line().left(0.8).at(switch.address).label("GP2-GP5", loc="left")
    d += elm.Ground().at(switch.common)
    d += elm.Line().right(1.2).at(switch.row).label("row", loc="top")
    row = d.here
    d += elm.Dot()
    d += elm.Resistor().up(2).at(row).label("1 kOhm", loc="bottom")
    d += elm.Vdd().label(".5 V")
    d += elm.ResistorVar().right(2.4).at(row).label("cell, 1 of 416", loc="bottom")
    d += elm.Line().right(1.2).label("column", loc="top")
    d += elm.Dot()
    return tuple(d.here)


def _multiplexer(pins: dict[str, tuple[str, str]], width: float) -> elm.Ic:
    """An integrated circuit with one pin a side; anchor -> label, side."""
    drawn = [
        elm.IcPin(label, side=side, slot="1/1", anchorname=anchor) for anchor, (label, side) in pins.items()
    ]
    return elm.Ic(pins=drawn, size=(width, 2.2))


def _amplifier(d: schemdraw.Drawing, column: tuple[float, float]) -> tuple[float, float]:
    d += elm.Line().right(0.8).at(column)
    amplifier = elm.Opamp().anchor("in1").label("1 of 26", loc="center", fontsize=8, ofst=(-0.25, 0))
    d += amplifier
    d += elm.Line().left(0.5).at(amplifier.in2)
    d += elm.Line().down(0.6)
    d += elm.Dot(open=True).label(".5 V", loc="bottom")
    d += elm.Line().up(1.5).at(column)
    left = d.here
    d += elm.Dot()
    d += elm.Resistor().right().tox(amplifier.out).label("Rf", loc="bottom")
    right = d.here
    d += elm.Dot()
    d += elm.Line().up(1.3).at(left)
    d += elm.Capacitor().right().tox(amplifier.out).label("Cf", loc="top")
    d += elm.Line().down(1.3)
    d += elm.Line().down().at(right).toy(amplifier.out)
    d += elm.Dot()
    return tuple(amplifier.out)


def _converter(d: schemdraw.Drawing, output: tuple[float, float]) -> None:
    d += elm.Line().right(1.0).at(output)
    pins = {"y": ("Y0-Y15", "left"), "address": ("S0-S3", "bottom"), "z": ("Z", "right")}
    columns = _multiplexer(pins, width=3.2)
    d += columns.label("74HC4067, columns 0-15", loc="top").anchor("y")
    d += elm.Line().down(0.8).at(columns.address)
    d += elm.Dot(open=True).label("GP6-GP9", loc="bottom")
    d += elm.Line().right(3.4).at(columns.z)
    inputs = [elm.IcPin(f"CH{i}", side="left", slot=f"{3 - i}/3", anchorname=f"ch{i}") for i in range(3)]
    wired = {"CLK": "GP18", "DOUT": "GP16", "DIN": "GP10", "CS": "GP17"}
    outputs = [
        elm.IcPin(name, side="right", slot=f"{4 - i}/4", anchorname=name) for i, name in enumerate(wired)
    ]
    converter = elm.Ic(pins=inputs + outputs, size=(3.6, 4)).label("MCP3204", loc="top").anchor("ch0")
    d += converter
    for name, pin in wired.items():
        d += elm.Line().right(0.8).at(getattr(converter, name)).label(pin, loc="right")
    d += elm.Line().left(1.0).at(converter.ch1).label("columns 16-25", loc="left")
    d += elm.Line().left(1.6).at(converter.ch2)
    d += elm.Line().down(2.2)
    potentiometer = elm.Potentiometer().down().anchor("tap").flip()
    d += potentiometer.label("displacement", loc="bottom")
    d += elm.Ground().at(potentiometer.end)
    d += elm.Vdd().at(potentiometer.start).label("3.3 V")


def _reference(d: schemdraw.Drawing) -> None:
    d += elm.Vdd().at((-4.2, -4.0)).label("3.3 V")
    d += elm.Resistor().down(1.8).at((-4.2, -4.0)).label("5.6 kOhm", loc="top")
    middle = d.here
    d += elm.Dot()
    d += elm.Resistor().down(1.8).label("1 kOhm", loc="top")
    d += elm.Ground()
    d += elm.Line().right(1.4).at(middle)
    d += elm.Dot()
    d += elm.Capacitor().down(1.8).label("100 nF", loc="bottom")
    d += elm.Ground()
    d += elm.Line().right(2.0).at((middle[0] + 1.4, middle[1]))
    buffer = elm.Opamp().flip().anchor("in2")
    d += buffer
    d += elm.Line().left(0.4).at(buffer.in1)
    d += elm.Line().down(1.0)
    d += elm.Line().right().tox(buffer.out)
    d += elm.Line().up().toy(buffer.out)
    d += elm.Dot()
    d += elm.Line().right(0.8).at(buffer.out)
    d += elm.Dot(open=True).label(".5 V", loc="right")


if __name__ == "__main__":
    schematic(FIGURES / "schematic.svg")
    heads = [f"cell at {FULL_SCALE_KPA:.0f} kPa", "feedback", "rms error", "largest error"]
    table(["circuit", *heads], crosstalk())
    table(["mm from the middle", "along", "across"], face())

"""Instructions of the machine code: a frame, a stroke, an estimate, on Cortex-M0 and M4.

    python -m tests.benchmarks.bench_machine_code

The viper functions run on an emulated processor that counts what it executes; nothing is timed, so the
figures are the same on every machine. MicroPython's floor division is a call into the interpreter: calls are
counted, their instructions are not. Nor is what calls the loops and stays bytecode.
"""

from __future__ import annotations

from array import array

from rich.console import Console
from rich.table import Table

from firmware_py import cobs, evaluator, pipeline, traces
from palpate.model_export.integers import compiler
from palpate.sim.probe.sensors import LEVELS, SensorModel, StrokeField
from tests.firmware_py import twins
from tests.firmware_py.strokes import read_strokes
from tests.model_export import synthetic
from tests.model_export.test_micropython import rows
from tests.sim.probe.machine_code import MachineCode

FRAMES = 50
ESTIMATES = 20
CORES = {"armv6m": "Cortex-M0", "armv7emsp": "Cortex-M4"}


def frames_and_stroke(architecture: str) -> dict[str, tuple[float, float]]:
    """(instructions, divisions) of each loop of the pipeline, by what is counted."""
    model = SensorModel(StrokeField(*read_strokes()[0]), LEVELS["typical"], 1)
    stream = model.stroke(FRAMES)
    code = MachineCode(twins.HOT, architecture, count=True)
    found = {}

    def spent(what: str, times: int = 1) -> None:
        found[what] = (code.instructions / times, code.divisions / times)
        code.instructions = code.divisions = 0

    p = pipeline.Pipeline(model.calibration())
    with twins.installed(twins.HOT, code) as calls:
        for k in range(FRAMES):
            p.add_frame(stream.packed[k], int(stream.positions_um[k]), int(stream.displacements_um[k]))
        spent("a frame: unpack and add", calls["put_cells"] + calls["add_cells"])
        p._take()
        spent(f"a stroke: calibrate {p.n} bins")
        work = array("i", bytes(4 * 256))
        pipeline.sum_rows(p.bins.cells, p._slot, p.n, 6, 20, p._rows, work)
        spent("a stroke: rows over the chosen columns")
        for k in range(p.n):
            work[k] = 4096
        start = int(p._x[p.n // 2]) - pipeline.HALF_UM
        for first in range(0, 26, 2):
            traces.map_columns(
                p._x, p.n, p.bins.cells, p._slot, work, start, p._wide, pipeline.POINTS, first, 2
            )
        spent("a stroke: 26 column maps")
    return found


def link(architecture: str) -> dict[str, tuple[float, float]]:
    """A whole frame's check sum and stuffing."""
    code = MachineCode(twins.LINK, architecture, count=True)
    n = 660
    data = bytearray(i * 37 & 255 for i in range(n + 4))
    code["_append"](data, n, *twins.half_byte_tables())
    found = {"a frame: CRC-32 of 660 bytes": (code.instructions, 0.0)}
    code.instructions = 0
    code["_encode"](data, n + 4, bytearray(cobs.worst_case(n + 4)), 0)
    found["a frame: COBS"] = (code.instructions, 0.0)
    return found


def estimates(architecture: str) -> dict[str, tuple[float, float]]:
    """The sums and products of an estimate."""
    found = {}
    out = array("i", bytes(4 * evaluator.OUT_SIZE))
    for kind, degree in (("thesis", 2), ("field", 2), ("field", 3)):
        spec = synthetic.model(kind, degree)
        tables = compiler.compile_model(spec)
        code = MachineCode(twins.EVALUATOR, architecture, count=True)
        with twins.installed(twins.EVALUATOR, code):
            for row in rows(spec, ESTIMATES):
                tables.evaluate(array("i", row), out)
        what = f"an estimate: {kind} model, {len(spec.terms) - 1} terms"
        found[what] = (code.instructions / ESTIMATES, code.divisions / ESTIMATES)
    return found


def main() -> None:
    """Print the instructions that each loop takes."""
    columns = {
        core: frames_and_stroke(architecture) | link(architecture) | estimates(architecture)
        for architecture, core in CORES.items()
    }
    table = Table("instructions", *columns, "divisions", title="The loops in machine code")
    for what in next(iter(columns.values())):
        numbers = [f"{column[what][0]:,.0f}" for column in columns.values()]
        table.add_row(what, *numbers, f"{next(iter(columns.values()))[what][1]:,.0f}")
    Console().print(table)


if __name__ == "__main__":
    main()

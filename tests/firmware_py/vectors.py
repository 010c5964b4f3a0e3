"""Random arguments for the loops that run on every frame and cell, as large as they can become, few enough
bins for the smallest interpreter.
"""

import importlib
from array import array
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from firmware_py import columns, stuck


def _words(random, n, low, high, kind="H"):
    return array(kind, random.integers(low, high, n).tolist())


def _cells(random, total):
    """(packed, at, cells, base): sums of up to 16 frames."""
    for _ in range(total):
        at, base = int(random.integers(0, 9)), 416 * int(random.integers(0, 3))
        yield random.bytes(at + 624), at, _words(random, base + 416, 0, 15 * 4095 + 1), base


def _calibrate(random, total):
    for k in range(total):
        n = 1 + (k % 8 == 0)  # its 416 divisions a bin are slow here
        slots = int(random.integers(n, 5))
        slot = bytearray(random.permutation(slots)[:n].tolist())
        counts = bytearray(random.integers(1, 17, slots).tolist())
        cells = _words(random, 416 * slots, 0, 4096)
        for k in range(slots):
            for i in range(416 * k, 416 * (k + 1)):
                cells[i] *= counts[k]
        gain = _words(random, 416, 0, 32768)
        fills = int(random.integers(0, 5))
        fill = _words(random, 3 * max(fills, 1), 0, 416)
        offset = _words(random, 416, 0, 32768)
        numbers = array("i", bytes(64 * n)), array("i", bytes(4 * n))
        yield cells, slot, n, counts, offset, gain, fill, 3 * fills, *numbers


def _rows(random, total):
    for _ in range(total):
        n = int(random.integers(1, 4))
        first = int(random.integers(0, 25))
        last = int(random.integers(first + 1, 27))
        slot = bytearray(random.permutation(n).tolist())
        numbers = array("i", bytes(64 * n)), array("i", bytes(4 * n))
        yield _words(random, 416 * n, 0, 65536), slot, n, first, last, *numbers


def _map(random, total):
    for _ in range(total):
        n, points = int(random.integers(2, 6)), int(random.integers(1, 5))
        x_um = array("i", np.cumsum(random.integers(100, 9000, n)).tolist())
        slot = bytearray(random.permutation(n).tolist())
        level = _words(random, n, 0, 8192, "i")
        start = int(random.integers(-9000, 30000))
        out = array("i", bytes(104 * points))
        first = int(random.integers(0, 26))
        count = int(random.integers(1, 27 - first))
        yield x_um, n, _words(random, 416 * n, 0, 65536), slot, level, start, out, points, first, count


def _levels(random, total):
    for _ in range(total):
        n = int(random.integers(1, 33))
        force = _words(random, n, -5000, 2_097_137, "i")
        yield force, int(random.integers(0, 2_097_137)), n, array("i", bytes(4 * n))


def _bump(random, total):
    for _ in range(total):
        points = int(random.integers(8, 24))
        centre, stdev = int(random.integers(0, points << 16)), int(random.integers(98304, 1638401))
        yield points, centre, stdev, array("i", bytes(4 * points))


def _respond(random, total):
    for points, centre, stdev, bump in _bump(random, total):
        norm = columns.make_bump(points, centre, stdev, bump) or 4
        maps = _words(random, 26 * points, -200_000, 500_000, "i")
        first = int(random.integers(0, 26))
        yield maps, points, bump, norm, array("i", bytes(104)), first, int(random.integers(1, 27 - first))


def _answer(random):
    bump = np.exp(-(((np.arange(26) - random.uniform(0, 26)) / random.uniform(1, 12)) ** 2))
    answer = random.integers(100, 9000) * bump + random.integers(1, 300) * random.normal(size=26)
    return array("i", answer.astype(int).tolist())


def _choose(random, total):
    for _ in range(total):
        yield _answer(random), array("i", bytes(104)), array("i", bytes(8))


def _rings(random, total):
    for k in range(total):
        yield _answer(random), array("i", bytes(104)), array("i", bytes(20)), k % 3


def _even_out(random, total):
    for _ in range(total):
        n = int(random.integers(2, 25))
        x_um = array("i", np.cumsum(random.integers(500, 4500, n)).tolist())
        force = _words(random, n, -5000, 2_097_137, "i")
        level = int(random.integers(1, 2_097_137))
        if random.random() < 0.5:  # a hand that wanders by a tenth
            force = array("i", (level * random.uniform(0.9, 1.1, n)).astype(int).tolist())
        part = array("i", (np.array(force) * random.uniform(-0.1, 1.2, n)).astype(int).tolist())
        rows = _words(random, 16 * n, -2000, 131_072, "i")
        yield x_um, n, int(random.integers(0, 60_000)), rows, part, force, level


def _mend(random, total):
    for _ in range(total):
        n = int(random.integers(2, 5))
        counts = bytearray(random.integers(1, 17, n).tolist())
        cells = _words(random, 416 * n, 1, 4095)
        for i in range(416 * n):
            cells[i] *= counts[i // 416]
        for i in random.integers(0, 416, 30).tolist():
            reads = (0, 4095, 2000)[i % 3]
            for k in range(n):
                cells[416 * k + i] = (reads + (k % 2 if i % 3 == 2 else 0)) * counts[k]
        dead = bytearray((random.integers(0, 256, 52) & random.integers(0, 256, 52)).tolist())
        slot = bytearray(random.permutation(n).tolist())
        yield cells, slot, n, counts, dead, array("i", bytes(208)), array("h", bytes(4 * stuck.MOST))


def _plan_fill(random, total):
    for _ in range(total):
        dead = random.integers(0, 256, 52)
        for _ in range(int(random.integers(0, 4))):
            dead &= random.integers(0, 256, 52)
        yield bytearray(dead.tolist()), array("H", bytes(6 * 416))


def _full(random, total):
    for _ in range(total):
        count, base = int(random.integers(1, 17)), 416 * int(random.integers(0, 3))
        cells = _words(random, base + 416, 0, 4096 * count)
        for i in random.integers(0, base + 416, 20).tolist():
            cells[i] = 4095 * count
        dead = bytearray((random.integers(0, 256, 52) & random.integers(0, 256, 52)).tolist())
        yield cells, base, 4095 * count, dead


_MAKERS = {
    "bins.put_cells": _cells,
    "bins.add_cells": _cells,
    "calib.calibrate_bins": _calibrate,
    "calib.plan_fill": _plan_fill,
    "pipeline.sum_rows": _rows,
    "pipeline.levels": _levels,
    "traces.map_columns": _map,
    "columns.make_bump": _bump,
    "columns.respond": _respond,
    "columns.choose": _choose,
    "columns.rings": _rings,
    "columns.even_out": _even_out,
    "stuck.mend": _mend,
    "stuck.full": _full,
}
NAMES = tuple(_MAKERS)


def of(name: str, total: int) -> Iterator[tuple[Any, ...]]:
    """`total` random calls of "module.function"."""
    return _MAKERS[name](np.random.default_rng(7), total)


def plain(name: str) -> Callable[..., Any]:
    """The firmware's own function of that name."""
    module, _, function = name.rpartition(".")
    return getattr(importlib.import_module(f"firmware_py.{module}"), function)

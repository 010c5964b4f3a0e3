"""The hot loops once more in viper: machine code, and the same integers, on boards that have it.

    from firmware_py import hot_viper
    hot_viper.install()

puts them in the place of the plain ones. Viper's integers are 32 bits and wrap silently; nothing here
leaves +-2^30: tests/firmware_py checks it on the plain loops and, with viper's types read as plain Python, on
these.
Ports without viper (WebAssembly) do not import this file.

No number here needs more than 16 bits, zeros at its end not counted. On a Cortex-M0 such a number would lie
between the instructions and be loaded from an address that is a multiple of four, and MicroPython's build
aligns frozen machine code to two bytes only: half of the number would be the instruction in front of it.
"""

# ruff: noqa: F821 - ptr8, ptr16 and ptr32 are viper's own
import micropython

from firmware_py import bins, calib, geometry, pipeline, traces

_ROWS = geometry.ROWS
_COLUMNS = geometry.COLUMNS
_CELLS = geometry.CELLS
_FRAME_BYTES = geometry.FRAME_BYTES
_PITCH_UM = geometry.PITCH_UM
_FIRST_ROW_UM = geometry.FIRST_ROW_UM


@micropython.viper
def put_cells(packed: ptr8, at: int, cells: ptr16, base: int):
    """See bins.put_cells."""
    end = at + int(_FRAME_BYTES)
    while at < end:
        b = packed[at + 1]
        cells[base] = packed[at] | (b & 15) << 8
        cells[base + 1] = b >> 4 | packed[at + 2] << 4
        at += 3
        base += 2


@micropython.viper
def add_cells(packed: ptr8, at: int, cells: ptr16, base: int):
    """See bins.add_cells."""
    end = at + int(_FRAME_BYTES)
    while at < end:
        b = packed[at + 1]
        cells[base] = cells[base] + (packed[at] | (b & 15) << 8)
        cells[base + 1] = cells[base + 1] + (b >> 4 | packed[at + 2] << 4)
        at += 3
        base += 2


@micropython.viper
def calibrate_bins(
    cells: ptr16,
    slot: ptr8,
    n: int,
    counts: ptr8,
    offset: ptr16,
    gain: ptr16,
    fill: ptr16,
    fills: int,
    rows: ptr32,
    total: ptr32,
):
    """See calib.calibrate_bins."""
    top = 131072
    rows_ = int(_ROWS)
    columns = int(_COLUMNS)
    size = int(_CELLS)
    k = 0
    while k < n:
        base = slot[k] * size
        count = counts[slot[k]]
        i = 0
        at = rows_ * k
        end = at + rows_
        while at < end:
            s = 0
            e = i + columns
            while i < e:
                v = (cells[base + i] * 8 // count - offset[i]) * gain[i] >> 9
                s += v
                v = (v >> 4) + 4096
                if v < 0:
                    v = 0
                elif v > 65535:
                    v = 65535
                cells[base + i] = v
                i += 1
            rows[at] = s
            at += 1
        i = 0
        while i < fills:
            v = (cells[base + fill[i + 1]] + cells[base + fill[i + 2]]) >> 1
            cells[base + fill[i]] = v
            at = rows_ * k + fill[i] // columns
            rows[at] = rows[at] + ((v - 4096) << 4)
            i += 3
        s = 0
        at = rows_ * k
        while at < end:
            v = rows[at] // (4 * columns)
            if v >= top:
                v = top - 1
            elif v <= -top:
                v = 1 - top
            rows[at] = v
            s += v
            at += 1
        total[k] = s
        k += 1


@micropython.viper
def sum_rows(cells: ptr16, slot: ptr8, n: int, first: int, last: int, rows: ptr32, total: ptr32):
    """See pipeline.sum_rows."""
    top = 131072
    width = last - first
    rows_ = int(_ROWS)
    columns = int(_COLUMNS)
    size = int(_CELLS)
    at = 0
    k = 0
    while k < n:
        base = slot[k] * size + first
        t = 0
        i = 0
        while i < rows_:
            s = -4096 * width
            j = base
            e = base + width
            while j < e:
                s += cells[j]
                j += 1
            s = (s << 2) // width
            if s >= top:
                s = top - 1
            rows[at] = s
            t += s
            at += 1
            base += columns
            i += 1
        total[k] = t
        k += 1


@micropython.viper
def map_columns(
    x_um: ptr32,
    n: int,
    cells: ptr16,
    slot: ptr8,
    level: ptr32,
    start_um: int,
    out: ptr32,
    points: int,
    first: int,
    columns: int,
):
    """See traces.map_columns."""
    rows_ = int(_ROWS)
    width = int(_COLUMNS)
    size = int(_CELLS)
    pitch = int(_PITCH_UM)
    end = points * columns
    j = 0
    while j < end:
        out[j] = 0
        j += 1
    s = int(_FIRST_ROW_UM)
    row = 0
    while row < rows_:
        k = 0
        x = start_um - s
        i = 0
        while i < points:
            while k < n - 2 and x_um[k + 1] <= x:
                k += 1
            t = x - x_um[k]
            h = x_um[k + 1] - x_um[k]
            if t < 0:
                t = 0
            elif t > h:
                t = h
            v = (t << 12) // h
            u = (4096 - v) * level[k] >> 12
            v = v * level[k + 1] >> 12
            a = slot[k] * size + row * width + first
            b = slot[k + 1] * size + row * width + first
            j = i * columns
            e = j + columns
            while j < e:
                out[j] = out[j] + ((u * (cells[a] - 4096) + v * (cells[b] - 4096)) >> 12)
                a += 1
                b += 1
                j += 1
            x += 1000
            i += 1
        s += pitch
        row += 1
    if rows_ != 16:
        j = 0
        while j < end:
            out[j] = out[j] * 16 // rows_
            j += 1


def install():
    """Put the machine code in the place of the plain loops."""
    bins.put_cells = put_cells
    bins.add_cells = add_cells
    calib.calibrate_bins = calibrate_bins
    pipeline.sum_rows = sum_rows
    traces.map_columns = map_columns

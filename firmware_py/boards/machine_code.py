"""The twins in machine code, in the plain loops' place where the port has a compiler for them.

Each is tried beside its plain loop on the same numbers first. What a port cannot run, or runs to other
numbers, is left as it was: slower, the same integers.
"""

from array import array

from firmware_py import (
    bins,
    calib,
    columns,
    forcemap,
    gauss,
    geometry,
    pipeline,
    polynomial,
    profile,
    search,
    stroke_state,
    traces,
)


def _cells():
    """A bin of cells, no two alike."""
    out = array("H", bytes(2 * geometry.CELLS))
    for i in range(geometry.CELLS):
        out[i] = i * 40503 & 0xFFFF
    return out


def _numbers(n):
    return array("i", bytes(4 * n))


def _packed(fast):
    packed = bytes([i * 151 & 255 for i in range(geometry.FRAME_BYTES)])
    mine = _cells()
    theirs = array("H", mine)
    bins.put_cells(packed, 0, mine, 0)
    fast.put_cells(packed, 0, theirs, 0)
    same = mine == theirs
    bins.add_cells(packed, 0, mine, 0)
    fast.add_cells(packed, 0, theirs, 0)
    return same and mine == theirs


def _bins(fast):
    c = calib.Calibration()
    c.set_dead((30, geometry.CELLS // 2 - 8))
    counts = bytes((15,))
    slot = bytes((0, 0))
    mine = _cells()
    theirs = array("H", mine)
    a = _numbers(geometry.ROWS + 2)
    b = _numbers(geometry.ROWS + 2)
    total = _numbers(1)
    calib.calibrate_bins(mine, slot, 1, counts, c.offset, c.gain, c.fill, c.fills, a, total)
    fast.calibrate_bins(theirs, slot, 1, counts, c.offset, c.gain, c.fill, c.fills, b, total)
    if mine != theirs or a != b:
        return False
    pipeline.sum_rows(mine, slot, 1, 3, geometry.COLUMNS - 3, a, total)
    fast.sum_rows(mine, slot, 1, 3, geometry.COLUMNS - 3, b, total)
    if a != b:
        return False
    x = array("i", (0, 1400))
    level = array("i", (4000, 4200))
    a = _numbers(geometry.COLUMNS)
    b = _numbers(geometry.COLUMNS)
    traces.map_columns(x, 2, mine, slot, level, -1500, a, 1, 3, 7)
    fast.map_columns(x, 2, mine, slot, level, -1500, b, 1, 3, 7)
    return a == b


def _frames():
    from firmware_py import hot_viper

    if not _packed(hot_viper) or not _bins(hot_viper):
        raise ValueError("other numbers")
    hot_viper.install()
    del hot_viper.install  # called once


def _halves(n, step):
    """n numbers of 16 bits with a sign, small enough to be summed."""
    out = array("h", bytes(2 * n))
    for i in range(n):
        out[i] = (i * step & 0x1FFF) - 0x1000
    return out


def _terms(fast):
    n = polynomial.OUTPUTS
    c = _halves(8 * n, 1009)
    d = _halves(8 * n, 37)
    small = array("i", _halves(16, 2741))
    part = array("i", (-30000, 29999, -1234, 7, -1, 0, 23456, 1))
    own = array("i", (-123456789, 98765432, 0, 4711, -77, 31415926, 5))
    u = array("i", (-200000000, 123456789))
    head = _numbers(15)
    head[3] = 9  # of the low words' products; 14: how many sums
    head[11] = 19
    head[12] = 15
    steps = bytes((70, 5, 0, 2, 1, 4, 3, 192, 1, 160, 0, 1, 6))
    for head[14] in (n, 1):
        mine = _numbers(3 * n)
        theirs = _numbers(3 * n)
        for found, one in ((mine, polynomial), (theirs, fast)):
            one.nested(c, d, own, steps, u, part, small, head, found, 0, 9, 3, 74565)
            one.nested(c, d, own, steps, u, part, small, head, found, 9, 13, 5, 0)
        if mine != theirs:
            return False
    return fast.dot_high(c, 1, small, 2, 12) == polynomial.dot_high(c, 1, small, 2, 12)


def _model():
    from firmware_py import evaluator_viper

    if not _terms(evaluator_viper):
        raise ValueError("other numbers")
    evaluator_viper.install()
    del evaluator_viper.install


def _image(n):
    """n rows of pressures, no two alike, not all positive."""
    out = _numbers(geometry.ROWS * n)
    for i in range(len(out)):
        out[i] = (i * 40503 & 0xFFFF) - 3000
    return out


def _traced(fast):
    x = array("i", (0, 1400, 2900, 4500))
    rows = _image(4)
    a = _numbers(2)
    b = _numbers(2)
    w = _numbers(4 + geometry.ROWS)
    u = _numbers(4 + geometry.ROWS)
    traces.map_rows(x, 4, rows, -1200, a, 2, w)
    fast.map_rows(x, 4, rows, -1200, b, 2, u)
    same = a == b and w == u
    a = _numbers(profile.SIZE)
    b = _numbers(profile.SIZE)
    traces.weigh(x, 4, 1, 2000, w)
    for i in range(4):
        u[i] = w[i]
    for j in (-27, 1):
        profile.add_place(rows, x, 1, 4, j, a, w)
        fast.add_place(rows, x, 1, 4, j, b, u)
    return same and a == b and w == u


def _moved(fast):
    f = _numbers(forcemap.HEAD + forcemap.COEFS)
    for i in range(len(f)):
        f[i] = (i * 1009 & 511) - 255
    f[0] = 12
    w = _numbers(forcemap.WORK)
    rows = _image(1)
    total = forcemap.carry(rows, 0, 0, w, w, forcemap._IMAGE)
    u = array("i", w)
    forcemap.slopes(f, w, -3000, 2000, total)
    fast.slopes(f, u, -3000, 2000, total)
    same = w == u
    for i in range(geometry.ROWS):
        w[i] = (i - 8) << 17
    a = _image(1)
    for step in (-98765, 60000000):  # the second takes them to either end
        same = same and forcemap.carry(rows, 0, step, w, rows, 0) == fast.carry(a, 0, step, w, a, 0)
    return same and rows == a


def _fitted(fast):
    n = 6
    y = _image(1)
    w = _numbers(4 * n)
    s = _numbers(12)
    gauss.prepare(y, n, w, s)
    u = array("i", w)
    t = array("i", s)
    p = array("i", (0, 12345678, 180000, 100000, 0))
    base = gauss.residuals(n, p, w)
    same = base == fast.residuals(n, p, u) and w == u
    same = same and gauss.products(n, base, w, s) == fast.products(n, base, u, t)
    same = same and w == u and s == t
    search.centre_map(y, n, w)
    search.centre_map(y, n, u)
    reach = search.bump_table(2200, n, w)
    same = same and reach == fast.bump_table(2200, n, u)
    search.correlate(w, n, 2, reach, s)
    fast.correlate(u, n, 2, reach, t)
    a = _numbers(2)
    b = _numbers(2)
    columns.respond(y, 6, w, 999, a, 0, 2)
    fast.respond(y, 6, u, 999, b, 0, 2)
    return same and w == u and s == t and a == b


def _stroke():
    from firmware_py import stroke_viper

    if not _traced(stroke_viper) or not _moved(stroke_viper) or not _fitted(stroke_viper):
        raise ValueError("other numbers")
    stroke_viper.install()
    del stroke_viper.install


def _link():
    from firmware_py.boards import fast_link

    fast_link.use()
    del fast_link.use


def scan_part():
    """Of boards that measure by boards/scan.py."""
    from firmware_py.boards import fast_scan, scan_order

    raw = array("H", [i * 1103 & 4095 for i in range(scan_order.CONVERSIONS)])
    places = array("H", range(scan_order.CELLS))
    mine = bytearray(geometry.FRAME_BYTES)
    theirs = bytearray(geometry.FRAME_BYTES)
    scan_order.pack(raw, places, mine)
    fast_scan.pack(raw, places, theirs)  # type: ignore[arg-type]
    a = _numbers(geometry.ROWS)
    b = _numbers(geometry.ROWS)
    stroke_state.row_sums(mine, a)
    fast_scan.row_sums(mine, b)  # type: ignore[arg-type]
    if mine != theirs or a != b:
        raise ValueError("other numbers")
    fast_scan.install()
    del fast_scan.install


PARTS = (("link", _link), ("frames", _frames), ("model", _model), ("stroke", _stroke))


def install(parts=PARTS):
    """Put in whatever this port can run; returns a sentence for the log."""
    fast = []
    why = ""
    for name, put in parts:
        try:
            put()
            fast.append(name)
        except (ImportError, SyntaxError, AttributeError, ValueError, NotImplementedError, RuntimeError) as e:
            why = f"{type(e).__name__}: {e}"
        except MemoryError:
            why = "no memory to compile"
    if len(fast) == len(parts):
        return "machine code: " + ", ".join(fast)
    return "machine code: {}; the rest in plain loops ({})".format(", ".join(fast) or "none", why)

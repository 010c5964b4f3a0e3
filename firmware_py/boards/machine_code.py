"""The twins in machine code, in the plain loops' place where the port has a compiler for them.

Each is tried beside its plain loop on the same numbers first. What a port cannot run, or runs to other
numbers, is left as it was: slower, the same integers.
"""

from array import array

from firmware_py import bins, calib, geometry, pipeline, polynomial, stroke_state, traces


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


def _halves(n, step):
    """n numbers of 16 bits with a sign, small enough to be summed."""
    out = array("h", bytes(2 * n))
    for i in range(n):
        out[i] = (i * step & 0x1FFF) - 0x1000
    return out


def _terms(fast):
    c = _halves(40, 1009)
    d = _halves(40, 37)
    small = array("i", _halves(16, 2741))
    part = array("i", (-30000, 29999, -1234, 7, -1, 0, 23456, 1))
    mine = _numbers(15)
    theirs = _numbers(15)
    steps = bytes((6, 5, 0, 2, 1, 4, 3))
    downs = 74565
    polynomial.sums(c, d, 5, part, small, steps, 1, 7, 5, downs, mine, 10)
    fast.sums(c, d, 5, part, small, steps, 1, 7, 5, downs, theirs, 10)
    if mine != theirs or fast.dot_high(c, 1, small, 2, 12) != polynomial.dot_high(c, 1, small, 2, 12):
        return False
    own = array("i", (5, -123456789, 98765432, 0, 4711, -77))
    for u in (-200000000, 123456789):
        polynomial.carry(own, 1, u, 10, mine)
        fast.carry(own, 1, u, 10, theirs)
    return mine == theirs


def _model():
    from firmware_py import evaluator_viper

    if not _terms(evaluator_viper):
        raise ValueError("other numbers")
    evaluator_viper.install()


def _link():
    from firmware_py.boards import fast_link

    fast_link.use()


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


PARTS = (("link", _link), ("frames", _frames), ("model", _model))


def install(parts=PARTS):
    """Put in whatever this port can run; returns a sentence for the log."""
    fast = []
    why = ""
    for name, put in parts:
        try:
            put()
            fast.append(name)
        except (ImportError, SyntaxError, AttributeError, ValueError, NotImplementedError, RuntimeError) as e:
            why = "%s: %s" % (type(e).__name__, e)
        except MemoryError:
            why = "no memory to compile"
    if len(fast) == len(parts):
        return "machine code: " + ", ".join(fast)
    return "machine code: %s; the rest in plain loops (%s)" % (", ".join(fast) or "none", why)

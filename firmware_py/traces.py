"""Point traces (Method 2): what one sensor reads as the probe carries it over a point of the skin.

A cubic through four neighbouring bins (slopes from the chords beside a gap) gives the trace between
the uneven encoder positions; beyond the ends a trace keeps its last value. Lengths in micrometres;
weights in Q12, adding up to 1 exactly; rows in Q5 counts; maps in Q11 counts.
"""

from firmware_py import geometry

_ROWS = geometry.ROWS
_COLUMNS = geometry.COLUMNS
_CELLS = geometry.CELLS
_PITCH_UM = geometry.PITCH_UM
_FIRST_ROW_UM = geometry.FIRST_ROW_UM


def weigh(x_um, n, k, x, w):
    """Weights of the bins k - 1 to k + 2 at x, in w[0..3]; those of absent neighbours are 0."""
    w[0] = 0
    w[3] = 0
    t = x - x_um[k]
    h = x_um[k + 1] - x_um[k]
    if t <= 0 or t >= h:
        w[1] = 4096 if t <= 0 else 0
        w[2] = 4096 - w[1]
        return
    t = (t << 12) // h
    t2 = (t * t + 2048) >> 12
    t3 = (t2 * t + 2048) >> 12
    up = 3 * t2 - 2 * t3
    left = t - 2 * t2 + t3
    right = t3 - t2
    if k > 0:
        w[0] = -(left * h // (x_um[k + 1] - x_um[k - 1]))
        up -= w[0]
    else:
        up += left
    if k + 2 < n:
        w[3] = right * h // (x_um[k + 2] - x_um[k])
        w[2] = up
        w[1] = 4096 - up - w[0] - w[3]
    else:
        w[2] = up + right
        w[1] = 4096 - w[2] - w[0]


def at(rows, stride, i, k, n, w):
    """The value of channel i (of `stride`) at the point whose interval and weights are k and w."""
    j = k * stride + i
    v = w[1] * rows[j] + w[2] * rows[j + stride]
    if w[0]:
        v += w[0] * rows[j - stride]
    if w[3]:
        v += w[3] * rows[j + 2 * stride]
    return v >> 12


def rescale(out, n):
    """Make sums over all rows into means of 16, which is what the maps' units count on."""
    if _ROWS != 16:
        for i in range(n):
            out[i] = out[i] * 16 // _ROWS


def map_rows(x_um, n, rows, start_um, out, points, w):
    """Tactile map on `points` places 1 mm apart from start_um: the mean of the rows' traces, Q11."""
    for i in range(points):
        out[i] = 0
    s = _FIRST_ROW_UM
    stride = _ROWS
    for row in range(stride):
        k = 0
        x = start_um - s
        for i in range(points):
            while k < n - 2 and x_um[k + 1] <= x:
                k += 1
            weigh(x_um, n, k, x, w)
            j = k * stride + row
            v = w[1] * rows[j] + w[2] * rows[j + stride]
            if w[0]:
                v += w[0] * rows[j - stride]
            if w[3]:
                v += w[3] * rows[j + 2 * stride]
            out[i] += v >> 10
            x += 1000
        s += _PITCH_UM
    rescale(out, points)


def map_columns(x_um, n, cells, slot, level, start_um, out, points, first, columns):
    """The same map for each of `columns` columns from `first` on, from calibrated cells, Q7 counts.

    out[point * columns + column - first].

    `level[k]` (Q12, below 2) multiplies bin k, which takes out most of a wandering force. Between two
    bins the trace is straight: these maps only have to tell the columns apart.
    """
    for i in range(points * columns):
        out[i] = 0
    s = _FIRST_ROW_UM
    for row in range(_ROWS):
        k = 0
        x = start_um - s
        for i in range(points):
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
            a = slot[k] * _CELLS + row * _COLUMNS + first
            b = slot[k + 1] * _CELLS + row * _COLUMNS + first
            j = i * columns
            e = j + columns
            while j < e:
                out[j] += (u * (cells[a] - 4096) + v * (cells[b] - 4096)) >> 12
                a += 1
                b += 1
                j += 1
            x += 1000
        s += _PITCH_UM
    rescale(out, points * columns)

"""A function of one feature as a table of cubics (`device.lookup`)."""

from __future__ import annotations

import numpy as np

from palpate.fixedpoint.device import Table
from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.space import Array, Atom

CLOSE = 1e-7
"""Of the function's range: how near the cubics come."""
MOST_PIECES = 400
ROOM = 1 << 29
_NODES = (1 - np.cos((np.arange(4) + 0.5) * np.pi / 4)) / 2
_TRIED = np.linspace(0, 1, 13)


def table(atom: Atom, close: float = CLOSE) -> Table:
    """The table of z in Q28; its pieces are halved until they are close to the function, or one step wide."""
    of = atom.of
    kinks = {of.first_at(k): k for k in atom.kinks}
    first = np.array(sorted({of.lo, *(k for k in kinks if of.lo < k <= of.hi)}))
    left = np.stack([first, np.append(first[1:], of.hi + 1)], axis=1)
    done: dict[int, list[int]] = {}
    while len(left):
        rows, good = _cubics(atom, left, kinks, close)
        done |= {int(b): row for b, row in zip(left[good, 0], rows[good].tolist())}
        halved = left[~good]
        middle = halved.sum(axis=1) // 2
        left = np.vstack([np.stack([halved[:, 0], middle], axis=1), np.stack([middle, halved[:, 1]], axis=1)])
        if len(done) + len(left) > MOST_PIECES:
            raise CompileError(
                f"{atom.name} is too rough over the box of {of.name} for a table of {MOST_PIECES} pieces; "
                "narrow the box or take a smoother function"
            )
    return Table(tuple(sorted(done)), tuple(v for b in sorted(done) for v in done[b]), of.hi)


def _cubics(atom: Atom, pieces: Array, kinks: dict[int, float], close: float) -> tuple[Array, Array]:
    """Shift and coefficients of each piece (begin, end), and whether it is close enough."""
    begin, last = pieces[:, 0], pieces[:, 1] - pieces[:, 0] - 1
    shift = np.array([28 - int(n).bit_length() for n in last])
    scale = 2.0 ** (28 - shift)  # steps of t = 1
    nodes, tried = _NODES * last[:, None], _TRIED * last[:, None]
    # what was rounded down to a kink is meant to lie behind it
    least = np.array([kinks.get(int(b), -np.inf) for b in begin])
    z = _z(atom, begin[:, None] + np.hstack([nodes, tried]), least[:, None])
    at, want = z[:, : len(_NODES)], z[:, len(_NODES) :]
    flat = last < len(_NODES)  # a few steps: a constant, or halved
    powers = (nodes / scale[:, None])[:, :, None] ** np.arange(4)
    powers[flat] = np.eye(4)
    c = np.linalg.solve(powers, at[:, :, None])[:, :, 0]
    c[flat] = at[flat, :1] * [1, 0, 0, 0]
    got = np.einsum("nk,ntk->nt", c, (tried / scale[:, None])[:, :, None] ** np.arange(4))
    good = np.abs(got - want).max(axis=1) <= close
    good &= np.abs(c).sum(axis=1) * 2**28 < ROOM * 1.9
    good |= last == 0
    return np.hstack([shift[:, None], np.round(c * 2**28).astype(np.int64)]), good


def _z(atom: Atom, x: Array, least: Array) -> Array:
    """The atom at integers x, or between two of them, at values of at least `least`."""
    assert atom.function is not None
    x = np.clip(x, atom.of.lo, atom.of.hi)
    values = atom.function(np.maximum(x * atom.of.step, least).ravel())
    return (np.asarray(values, float).reshape(x.shape) - atom.centre) / atom.radius

"""Eight elements at once: the residual's arithmetic on vectors of eight numbers.

numba's own loops over nine nodes are not vectorised. Here each number of an element becomes a vector with one
lane per element, and LLVM's code is written out: multiply-adds in a stated order, so that the bits depend
neither on what the compiler makes of a loop nor on whether it comes fresh or from the cache.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 8
ROWS = 459
"""Numbers of an element: for each of 9 rows L and C0, then for each k and row g (x, y) and C's row."""

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)


@njit(cache=True, nogil=True)
def pack(g, C, L, C0):
    """Integrals of all elements (`element.ElementIntegrals`) as (groups, 459, 8), filled up with 0."""
    count = L.shape[0]
    out = np.zeros(((count + LANES - 1) // LANES, ROWS, LANES))
    for e in range(count):
        group = out[e // LANES]
        lane = e % LANES
        row = 0
        for a in range(9):
            for b in range(9):
                group[row + b, lane] = L[e, a, b]
                group[row + 9 + b, lane] = C0[e, a, b]
            row += 18
        for k in range(3):
            for a in range(9):
                group[row, lane] = g[e, 0, k, a]
                group[row + 1, lane] = g[e, 1, k, a]
                for b in range(9):
                    group[row + 2 + b, lane] = C[e, k, a, b]
                row += 11
    return out


class _Code:
    """Writes vector instructions; arrays are (n, 8) and given by their addresses."""

    def __init__(self, builder):
        self._builder = builder
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * 3)
        self._fma = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{LANES}f64")
        self.zero = ir.Constant(_VECTOR, [0.0] * LANES)

    def _place(self, address, row):
        array = self._builder.inttoptr(address, _VECTOR.as_pointer())
        return self._builder.gep(array, [ir.IntType(64)(row)])

    def load(self, address, row):
        return self._builder.load(self._place(address, row), align=8)

    def store(self, value, address, row):
        self._builder.store(value, self._place(address, row), align=8)

    def fma(self, a, b, c):
        """a b + c, rounded once."""
        return self._builder.call(self._fma, [a, b, c])

    def mul(self, a, b):
        return self._builder.fmul(a, b)

    def add(self, a, b):
        return self._builder.fadd(a, b)

    def sub(self, a, b):
        return self._builder.fsub(a, b)

    def minus_dot(self, row, u):
        """Minus the product of two rows of nine."""
        total = self.mul(row[0], u[0])
        for b in range(1, 8):
            total = self.fma(row[b], u[b], total)
        negative = self._builder.fneg
        return self.fma(negative(row[8]), u[8], negative(total))


@intrinsic
def eight_elements(typing_context, integrals, u, mu, bulk, pressures, forces, gradients, theta, excess):
    """Forces of eight elements, from addresses of arrays of rows of eight.

        theta_k = g_k . u + ux . C_k uy,   G_k = (gx_k + C_k uy, gy_k - C_k ux),   excess_k = q_k - k theta_k,
        forces = mu (L ux + C0 uy, L uy - C0 ux) + sum_k k theta_k G_k

    In: `integrals` (459), displacements `u` (18, nine x then nine y), `mu`, `bulk` (1) and `pressures` (3).
    Out: `forces` (18), the volume's `gradients` (54: k, then nine x and nine y), its change `theta` (3) and
    `excess` (3), what the pressures have more than it says.
    """

    def generate(context, builder, signature, values):
        integrals, u, mu, bulk, pressures, forces, gradients, theta, excess = values
        do = _Code(builder)
        ux = [do.load(u, a) for a in range(9)]
        uy = [do.load(u, 9 + a) for a in range(9)]
        shear = do.load(mu, 0)
        fx, fy = [], []
        for a in range(9):
            L = [do.load(integrals, 18 * a + b) for b in range(9)]
            C0 = [do.load(integrals, 18 * a + 9 + b) for b in range(9)]
            x = do.fma(C0[0], uy[0], do.mul(L[0], ux[0]))
            for b in range(1, 9):
                x = do.fma(C0[b], uy[b], do.fma(L[b], ux[b], x))
            y = do.minus_dot(C0, ux)
            for b in range(9):
                y = do.fma(L[b], uy[b], y)
            fx.append(do.mul(shear, x))
            fy.append(do.mul(shear, y))
        for k in range(3):
            t = do.zero
            G = []
            for a in range(9):
                row = 162 + 11 * (9 * k + a)
                C = [do.load(integrals, row + 2 + b) for b in range(9)]
                x, y = do.load(integrals, row), do.load(integrals, row + 1)
                t = do.fma(y, uy[a], t)
                for b in range(9):
                    x = do.fma(C[b], uy[b], x)
                y = do.add(y, do.minus_dot(C, ux))
                t = do.fma(x, ux[a], t)
                do.store(x, gradients, 18 * k + a)
                do.store(y, gradients, 18 * k + 9 + a)
                G.append((x, y))
            q = do.mul(do.load(bulk, 0), t)
            do.store(t, theta, k)
            do.store(do.sub(do.load(pressures, k), q), excess, k)
            for a, (x, y) in enumerate(G):
                fx[a] = do.fma(q, x, fx[a])
                fy[a] = do.fma(q, y, fy[a])
        for a in range(9):
            do.store(fx[a], forces, a)
            do.store(fy[a], forces, 9 + a)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 9), generate


@intrinsic
def fma(typing_context, a, b, c):
    """a b + c, rounded once."""

    def generate(context, builder, signature, values):
        return builder.fma(*values)

    return a(a, b, c), generate

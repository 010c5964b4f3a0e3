"""Eight elements at once: arithmetic of residual and stiffening on vectors of eight numbers.

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

POINTS, POINT_ROWS = 9, 19
"""Gauss points of an element, and numbers of each: nine gradients by x and nine by y, and its area."""
UPPER = 171
"""Numbers of a symmetric matrix (18, 18): its upper triangle, row by row."""

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


@njit(cache=True, nogil=True)
def pack_points(dN, dx):
    """Gradients (M, 9, 2, 9) and areas (M, 9) of Gauss points, as (groups, 9, 19, 8), filled up with 0."""
    count = dx.shape[0]
    out = np.zeros(((count + LANES - 1) // LANES, POINTS, POINT_ROWS, LANES))
    for e in range(count):
        group = out[e // LANES]
        lane = e % LANES
        for p in range(POINTS):
            for a in range(9):
                group[p, a, lane] = dN[e, p, 0, a]
                group[p, 9 + a, lane] = dN[e, p, 1, a]
            group[p, 18, lane] = dx[e, p]
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

    def negative(self, a):
        return self._builder.fneg(a)

    def minus_dot(self, row, u):
        """Minus the product of two rows of nine."""
        total = self.mul(row[0], u[0])
        for b in range(1, 8):
            total = self.fma(row[b], u[b], total)
        return self.fma(self.negative(row[8]), u[8], self.negative(total))


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
def eight_shears(typing_context, point, u, shears):
    """v1 = u_x,x - u_y,y and v2 = u_x,y + u_y,x at a Gauss point of eight elements.

    In: the point's 19 numbers, displacements `u` (18, nine x then nine y). Out: `shears` (2).
    """

    def generate(context, builder, signature, values):
        point, u, shears = values
        do = _Code(builder)
        v1 = v2 = do.zero
        for a in range(9):
            by_x, by_y = do.load(point, a), do.load(point, 9 + a)
            ux, uy = do.load(u, a), do.load(u, 9 + a)
            v1 = do.fma(by_x, ux, do.fma(do.negative(by_y), uy, v1))
            v2 = do.fma(by_y, ux, do.fma(by_x, uy, v2))
        do.store(v1, shears, 0)
        do.store(v2, shears, 1)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 3), generate


@intrinsic
def add_eight_forces(typing_context, point, shears, factor, forces):
    """Add f (v1 dv1 + v2 dv2) of a Gauss point to the `forces` (18) of eight elements; `factor` (1) is f."""

    def generate(context, builder, signature, values):
        point, shears, factor, forces = values
        do = _Code(builder)
        f = do.load(factor, 0)
        v1, v2 = (do.mul(f, do.load(shears, k)) for k in range(2))
        for a in range(9):
            by_x, by_y = do.load(point, a), do.load(point, 9 + a)
            x = do.fma(by_x, v1, do.fma(by_y, v2, do.load(forces, a)))
            y = do.fma(by_x, v2, do.fma(do.negative(by_y), v1, do.load(forces, 9 + a)))
            do.store(x, forces, a)
            do.store(y, forces, 9 + a)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 4), generate


@intrinsic
def add_eight_stiffnesses(typing_context, point, shears, factors, stiffnesses):
    """Add f (dv1 dv1 + dv2 dv2) + g w w of a Gauss point, w = v1 dv1 + v2 dv2, for eight elements.

    In: `factors` (2), f and g. `stiffnesses` (171) are upper triangles.
    """

    def generate(context, builder, signature, values):
        point, shears, factors, stiffnesses = values
        do = _Code(builder)
        f, g = (do.load(factors, k) for k in range(2))
        v1, v2 = (do.load(shears, k) for k in range(2))
        X, Y = ([do.load(point, 9 * k + a) for a in range(9)] for k in range(2))
        w = [do.fma(X[a], v1, do.mul(Y[a], v2)) for a in range(9)]
        w += [do.fma(X[a], v2, do.negative(do.mul(Y[a], v1))) for a in range(9)]
        dv1, dv2 = [*X, *map(do.negative, Y)], [*Y, *X]
        row = 0
        for a in range(18):
            by_w, by_1, by_2 = do.mul(g, w[a]), do.mul(f, dv1[a]), do.mul(f, dv2[a])
            for b in range(a, 18):
                more = do.fma(by_w, w[b], do.load(stiffnesses, row))
                do.store(do.fma(by_1, dv1[b], do.fma(by_2, dv2[b], more)), stiffnesses, row)
                row += 1
        return context.get_dummy_value()

    return types.void(*[types.intp] * 4), generate


@intrinsic
def fma(typing_context, a, b, c):
    """a b + c, rounded once."""

    def generate(context, builder, signature, values):
        return builder.fma(*values)

    return a(a, b, c), generate

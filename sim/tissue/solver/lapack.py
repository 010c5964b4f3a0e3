"""SciPy's BLAS and LAPACK called from compiled loops.

The routines' addresses come from `scipy.linalg.cython_blas` at run time and travel as arguments, so that
the compiled code stays in numba's cache.
"""

# mypy: ignore-errors
from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import get_cython_function_address, intrinsic


class Lapack(NamedTuple):
    """What `partial_cholesky` calls: addresses of potrf, trsm and syrk, and their constant arguments."""

    routines: np.ndarray
    letters: np.ndarray
    factors: np.ndarray


@cache
def lapack(single: bool) -> Lapack:
    """SciPy's own, for single or double precision."""
    letter, precision = ("s", np.float32) if single else ("d", np.float64)
    names = (
        ("cython_lapack", letter + "potrf"),
        ("cython_blas", letter + "trsm"),
        ("cython_blas", letter + "syrk"),
    )
    return Lapack(
        routines=np.array([get_cython_function_address(f"scipy.linalg.{m}", f) for m, f in names], np.int64),
        letters=np.frombuffer(b"LRTN", np.uint8).copy(),
        factors=np.array([1.0, -1.0], precision),
    )


@intrinsic
def call(typing_context, address, arguments):
    """Call the C function at `address` with pointers, given as a tuple of integers."""

    def generate(context, builder, signature, values):
        pointer = ir.IntType(8).as_pointer()
        count = len(signature.args[1])
        function = ir.FunctionType(ir.VoidType(), [pointer] * count).as_pointer()
        numbers = [builder.extract_value(values[1], i) for i in range(count)]
        builder.call(
            builder.inttoptr(values[0], function), [builder.inttoptr(number, pointer) for number in numbers]
        )
        return context.get_dummy_value()

    return types.void(address, arguments), generate


@njit(cache=True, nogil=True)
def partial_cholesky(M, first, pivots, n, lapack, sizes):
    """Eliminate rows `first` to `first + pivots` of the symmetric M[first:n, first:n], upper triangle.

    Afterwards these rows hold U with M = U^T U, and M[first + pivots : n, ...] the Schur complement.
    `lapack` is what `lapack()` gives, `sizes` is scratch, (4,) int32. False if a pivot is not positive.
    """
    # Row-major upper is LAPACK's column-major lower, so nothing is copied.
    stride = M.shape[1]
    rest = n - first - pivots
    sizes[0] = pivots
    sizes[1] = stride
    sizes[2] = rest
    sizes[3] = 0
    item = M.itemsize
    base = M.ctypes.data + item * (first * stride + first)
    below = base + item * pivots
    corner = base + item * pivots * (stride + 1)
    size = sizes.ctypes.data
    letter = lapack.letters.ctypes.data
    one = lapack.factors.ctypes.data
    lower, right, transposed, plain = letter, letter + 1, letter + 2, letter + 3
    call(lapack.routines[0], (lower, size, base, size + 4, size + 12))
    if sizes[3] != 0:
        return False
    if rest > 0:
        call(
            lapack.routines[1],
            (right, lower, transposed, plain, size + 8, size, one, base, size + 4, below, size + 4),
        )
        call(
            lapack.routines[2],
            (lower, plain, size + 8, size, one + item, below, size + 4, one, corner, size + 4),
        )
    return True

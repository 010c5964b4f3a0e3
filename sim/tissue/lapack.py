"""SciPy's BLAS and LAPACK called from compiled loops.

The routines' addresses come from `scipy.linalg.cython_blas` at run time and travel as arguments, so that
the compiled code stays in numba's cache.
"""

# mypy: ignore-errors
from __future__ import annotations

from functools import cache

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import get_cython_function_address, intrinsic


@cache
def routines() -> np.ndarray:
    """Addresses of dpotrf, dtrsm and dsyrk."""
    return np.array(
        [
            get_cython_function_address("scipy.linalg.cython_lapack", "dpotrf"),
            get_cython_function_address("scipy.linalg.cython_blas", "dtrsm"),
            get_cython_function_address("scipy.linalg.cython_blas", "dsyrk"),
        ],
        np.int64,
    )


@intrinsic
def _call(typing_context, address, arguments):
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


_LETTERS = np.frombuffer(b"LRTN", np.uint8).copy()
_FACTORS = np.array([1.0, -1.0])


@njit(cache=True, nogil=True)
def partial_cholesky(M, first, pivots, n, routines, letters, factors, sizes):
    """Eliminate rows `first` to `first + pivots` of the symmetric M[first:n, first:n], upper triangle.

    Afterwards these rows hold U with M = U^T U, and M[first + pivots : n, ...] the Schur complement.
    `letters` and `factors` are what `constants()` gives, `sizes` is scratch, (4,) int32. False if a pivot
    is not positive.
    """
    # Row-major upper is LAPACK's column-major lower, so nothing is copied.
    stride = M.shape[1]
    rest = n - first - pivots
    sizes[0] = pivots
    sizes[1] = stride
    sizes[2] = rest
    sizes[3] = 0
    item = 8
    base = M.ctypes.data + item * (first * stride + first)
    below = base + item * pivots
    corner = base + item * pivots * (stride + 1)
    size = sizes.ctypes.data
    letter = letters.ctypes.data
    one = factors.ctypes.data
    lower, right, transposed, plain = letter, letter + 1, letter + 2, letter + 3
    _call(routines[0], (lower, size, base, size + 4, size + 12))
    if sizes[3] != 0:
        return False
    if rest > 0:
        _call(
            routines[1],
            (right, lower, transposed, plain, size + 8, size, one, base, size + 4, below, size + 4),
        )
        _call(
            routines[2],
            (lower, plain, size + 8, size, one + 8, below, size + 4, one, corner, size + 4),
        )
    return True


def constants() -> tuple[np.ndarray, np.ndarray]:
    """What `partial_cholesky` takes as `letters` and `factors`."""
    return _LETTERS, _FACTORS

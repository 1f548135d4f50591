"""Routines of LAPACK that release the interpreter lock, in place on arrays in Fortran order.

The functions of `scipy.linalg.lapack` hold the lock, so that threads which factor matrices wait for
each other, and copy matrices in C order element by element. Here the same routines are called
by the addresses that SciPy exports for Cython.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["cholesky_in_place", "invert_lower_in_place"]

LOWER, UPPER, NOT_UNIT = (ctypes.c_char_p(letter) for letter in (b"L", b"U", b"N"))

ZERO = ctypes.c_double(0.0)


def cholesky_in_place(matrix: NDArray[np.float64]) -> bool:
    """Replace a matrix by its lower Cholesky factor; return whether it is positive definite.

    Parameters
    ----------
    matrix : ndarray [shape=(n, n), Fortran order]
        Only the lower triangle is used. Afterwards the upper one is 0.
    """
    size, leading, info = _sizes(matrix)
    _routine("dpotrf", 5)(LOWER, size, _address(matrix), leading, ctypes.byref(info))
    if matrix.shape[0] > 1:  # the triangle above the diagonal
        size_above = ctypes.byref(ctypes.c_int64(matrix.shape[0] - 1))
        zero = ctypes.byref(ZERO)
        above = _address(matrix[:, 1:])
        _routine("dlaset", 7)(UPPER, size_above, size_above, zero, zero, above, leading)
    return info.value == 0


def invert_lower_in_place(matrix: NDArray[np.float64]) -> bool:
    """Replace a lower triangular matrix by its inverse; return whether it has one.

    Parameters
    ----------
    matrix : ndarray [shape=(n, n), Fortran order]
    """
    size, leading, info = _sizes(matrix)
    _routine("dtrtri", 6)(LOWER, NOT_UNIT, size, _address(matrix), leading, ctypes.byref(info))
    return info.value == 0


def _sizes(matrix: NDArray[np.float64]) -> tuple[Any, Any, ctypes.c_int64]:
    """Return pointers to the order and the leading dimension, and a number for the outcome.

    Zero-extended to 64 bits, they are right for LAPACK with integers of either size.
    """
    rows, columns = matrix.shape
    if rows != columns or matrix.dtype != np.float64 or not matrix.flags.f_contiguous:
        raise ValueError("expected a square matrix of float64 in Fortran order")
    size = ctypes.byref(ctypes.c_int64(rows))
    return size, ctypes.byref(ctypes.c_int64(max(rows, 1))), ctypes.c_int64(0)


def _address(matrix: NDArray[np.float64]) -> ctypes.c_void_p:
    return ctypes.c_void_p(matrix.ctypes.data)


@cache
def _routine(name: str, arguments: int) -> Any:
    """Return a routine whose arguments are all pointers."""
    from scipy.linalg import cython_lapack  # slow to import

    capsule = cython_lapack.__pyx_capi__[name]
    get_name = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)
    get_pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)
    signature = get_name(("PyCapsule_GetName", ctypes.pythonapi))(capsule)
    address = get_pointer(("PyCapsule_GetPointer", ctypes.pythonapi))(capsule, signature)
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)(address)

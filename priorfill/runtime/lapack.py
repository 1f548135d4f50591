"""Routines of LAPACK that release the interpreter lock.

The functions of `scipy.linalg.lapack` hold the lock, so that threads which factor matrices wait for
each other, and copy matrices in C order element by element. Those of `scipy.linalg` check as long
as small systems take, and their import takes as long as many a fill. Here the same routines are
called by the addresses that SciPy exports for Cython, from the one module that has them.
"""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.array_address import array_address

__all__ = [
    "cholesky_in_place",
    "invert_lower_in_place",
    "solve_positive_banded",
    "solve_tridiagonal",
]

LOWER, UPPER, NOT_UNIT = (ctypes.c_char_p(letter) for letter in (b"L", b"U", b"N"))

ZERO = ctypes.c_double(0.0)


def cholesky_in_place(matrix: NDArray[np.float64]) -> bool:
    """Replace a matrix by its lower Cholesky factor; return whether it is positive definite.

    Parameters
    ----------
    matrix : ndarray [shape=(n, n), Fortran order]
        Or a part of one. Only the lower triangle is used. Afterwards the upper one is 0.
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
        Or a part of one: rows and columns from the same diagonal element on.
    """
    size, leading, info = _sizes(matrix)
    _routine("dtrtri", 6)(LOWER, NOT_UNIT, size, _address(matrix), leading, ctypes.byref(info))
    return info.value == 0


def solve_positive_banded(
    bands: NDArray[np.float64], right: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Solve a system with a symmetric, positive definite, banded matrix.

    Parameters
    ----------
    bands : ndarray [shape=(diagonals, n)]
        The matrix in upper banded form, as `scipy.linalg.solveh_banded` takes it.
    right : ndarray [shape=(n, k)]
        Right-hand sides.

    Returns
    -------
    ndarray [shape=(n, k), Fortran order]

    Raises
    ------
    ValueError
        If a value is not finite, or the number of unknowns differs.
    numpy.linalg.LinAlgError
        A ValueError, if the matrix is not positive definite.
    """
    if not (np.isfinite(bands).all() and np.isfinite(right).all()):
        raise ValueError("expected finite values")
    bands, solution = _system(bands, right)
    if not solution.size:
        return solution
    size, count, info = _lengths(solution)
    outcome = ctypes.byref(info)
    if len(bands) == 2:
        arrays = bands[1].copy(), bands[0, 1:].copy(), solution
        _routine("dptsv", 7)(size, count, *map(_address, arrays), size, outcome)
    else:
        matrix = np.array(bands, order="F")
        rows, columns, _ = _lengths(matrix)
        above = ctypes.byref(ctypes.c_int64(len(bands) - 1))
        arguments = UPPER, columns, above, count, _address(matrix), rows, _address(solution)
        _routine("dpbsv", 9)(*arguments, size, outcome)
    if info.value:
        raise np.linalg.LinAlgError("a matrix is not positive definite")
    return solution


def solve_tridiagonal(
    bands: NDArray[np.float64], right: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Solve a system with a tridiagonal matrix.

    Parameters
    ----------
    bands : ndarray [shape=(3, n)]
        The matrix, as `scipy.linalg.solve_banded` takes it.
    right : ndarray [shape=(n, k)]
        Right-hand sides.

    Returns
    -------
    ndarray [shape=(n, k), Fortran order]

    Raises
    ------
    ValueError
        If the number of unknowns differs.
    numpy.linalg.LinAlgError
        If the matrix is singular.
    """
    bands, solution = _system(bands, right)
    if not solution.size:
        return solution
    size, count, info = _lengths(solution)
    above, diagonal, below = bands[0, 1:].copy(), bands[1].copy(), bands[2, :-1].copy()
    addresses = map(_address, (below, diagonal, above, solution))
    _routine("dgtsv", 8)(size, count, *addresses, size, ctypes.byref(info))
    if info.value:
        raise np.linalg.LinAlgError("a matrix is singular")
    return solution


def _system(
    bands: NDArray[np.float64], right: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a banded matrix and a copy of right-hand sides as LAPACK reads them."""
    if bands.shape[1:] != right.shape[:1] or right.ndim != 2:
        raise ValueError(f"bands {bands.shape} do not fit right-hand sides {right.shape}")
    return np.asarray(bands, dtype=np.float64), np.array(right, dtype=np.float64, order="F")


def _lengths(solution: NDArray[np.float64]) -> tuple[Any, Any, ctypes.c_int64]:
    """Return pointers to the numbers of rows and columns, and a number for the outcome."""
    rows, columns = (ctypes.byref(ctypes.c_int64(length)) for length in solution.shape)
    return rows, columns, ctypes.c_int64(0)


def _sizes(matrix: NDArray[np.float64]) -> tuple[Any, Any, ctypes.c_int64]:
    """Return pointers to the order and the leading dimension, and a number for the outcome.

    Zero-extended to 64 bits, they are right for LAPACK with integers of either size.
    """
    rows, columns = matrix.shape
    size = ctypes.byref(ctypes.c_int64(rows))
    apart, step = matrix.strides[1] // 8, matrix.strides[0]
    contiguous = matrix.flags.f_contiguous
    part_of_one = step == 8 and apart >= rows and matrix.strides[1] % 8 == 0
    if (
        rows != columns
        or matrix.dtype != np.float64
        or not matrix.flags.behaved
        or not (contiguous or part_of_one)
    ):
        raise ValueError("expected a writable square matrix of float64 in Fortran order")
    leading = max(rows, 1) if contiguous else apart
    return size, ctypes.byref(ctypes.c_int64(leading)), ctypes.c_int64(0)


def _address(matrix: NDArray[np.float64]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array_address(matrix))


_LOADING = Lock()
"""Held while the module of routines is loaded: it cannot be loaded by two threads at a time."""


@cache
def _routine(name: str, arguments: int) -> Any:
    """Return a routine whose arguments are all pointers."""
    with _LOADING:
        capsule = _cython_lapack().__pyx_capi__[name]
    get_name = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)
    get_pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)
    signature = get_name(("PyCapsule_GetName", ctypes.pythonapi))(capsule)
    address = get_pointer(("PyCapsule_GetPointer", ctypes.pythonapi))(capsule, signature)
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)(address)


@cache
def _cython_lapack() -> ModuleType:
    """Return `scipy.linalg.cython_lapack`, without its package where that is not imported yet.

    The package imports much besides, for example test frameworks.
    """
    import scipy

    name = "scipy.linalg.cython_lapack"
    if "scipy.linalg" not in sys.modules:
        folder = Path(scipy.__file__).parent / "linalg"
        spec = PathFinder.find_spec(name, [str(folder)])
        if spec is not None and spec.loader is not None:
            module = module_from_spec(spec)
            spec.loader.exec_module(module)
            sys.modules.pop(name, None)  # so that whoever imports it finds it in its package
            return module
    return import_module(name)

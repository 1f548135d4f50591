"""Routines of LAPACK that release the interpreter lock.

The functions of `scipy.linalg.lapack` hold the lock, so that threads which factor matrices wait for
each other, and copy matrices in C order element by element. Those of `scipy.linalg` check as long
as small systems take, and their import takes as long as many a fill. Here the same routines are
called by the addresses that SciPy exports for Cython, from the modules that have them. Compiled
functions call an `ExternalRoutine` by its address as well.
"""

from __future__ import annotations

import ctypes
import sys
from dataclasses import dataclass
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
    "DGEMM",
    "DPOTRF",
    "DSYRK",
    "DTRMM",
    "DTRTRI",
    "EXTERNAL",
    "ExternalRoutine",
    "solve_positive_banded",
    "solve_tridiagonal",
]

UPPER = ctypes.c_char_p(b"U")


@dataclass(frozen=True)
class ExternalRoutine:
    """A routine of BLAS or LAPACK that compiled functions call (`priorfill.runtime.compiled`).

    All arguments are addresses: of letters, of numbers of 8 bytes, and of arrays in Fortran order.

    Attributes
    ----------
    name : str
        In lower case, without underscores.
    arguments : int
        Their number.
    """

    name: str
    arguments: int

    @property
    def symbol(self) -> str:
        """Its name in compiled code: one that no library has."""
        return f"priorfill_{self.name}"

    @property
    def address(self) -> int:
        """Where it is in memory."""
        return _address_of(self.name)

    def __call__(self, *addresses: int) -> None:
        """Call it from Python."""
        _routine(self.name, self.arguments)(*addresses)


DGEMM = ExternalRoutine("dgemm", 13)
DPOTRF = ExternalRoutine("dpotrf", 5)
DSYRK = ExternalRoutine("dsyrk", 10)
DTRMM = ExternalRoutine("dtrmm", 11)
DTRTRI = ExternalRoutine("dtrtri", 6)

EXTERNAL = {routine.symbol: routine for routine in (DGEMM, DPOTRF, DSYRK, DTRMM, DTRTRI)}
"""The routines that compiled functions may call, by their symbols."""


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


def _address(matrix: NDArray[np.float64]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array_address(matrix))


_LOADING = Lock()
"""Held while a module of routines is loaded: it cannot be loaded by two threads at a time."""

BLAS = {"dgemm", "dsyrk", "dtrmm"}
"""Routines that `scipy.linalg.cython_blas` has; all others are in `cython_lapack`."""


@cache
def _routine(name: str, arguments: int) -> Any:
    """Return a routine whose arguments are all pointers."""
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)(_address_of(name))


@cache
def _address_of(name: str) -> int:
    """Return where a routine is in memory."""
    with _LOADING:
        module = _exporting_module("cython_blas" if name in BLAS else "cython_lapack")
        capsule = module.__pyx_capi__[name]
    get_name = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)
    get_pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)
    signature = get_name(("PyCapsule_GetName", ctypes.pythonapi))(capsule)
    return int(get_pointer(("PyCapsule_GetPointer", ctypes.pythonapi))(capsule, signature))


@cache
def _exporting_module(module_name: str) -> ModuleType:
    """Return a module of `scipy.linalg`, without this package where that is not imported yet.

    The package imports much besides, for example test frameworks.
    """
    import scipy

    name = f"scipy.linalg.{module_name}"
    if "scipy.linalg" not in sys.modules:
        folder = Path(scipy.__file__).parent / "linalg"
        spec = PathFinder.find_spec(name, [str(folder)])
        if spec is not None and spec.loader is not None:
            module = module_from_spec(spec)
            spec.loader.exec_module(module)
            sys.modules.pop(name, None)  # so that whoever imports it finds it in its package
            return module
    return import_module(name)

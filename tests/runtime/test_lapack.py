"""Routines of LAPACK called by their addresses, compared with SciPy's wrappers."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy.linalg import solve_banded, solveh_banded

from priorfill.runtime.lapack import DPOTRF, solve_positive_banded, solve_tridiagonal


def test_a_routine_is_called_from_python() -> None:
    matrix = np.array([[4.0, 2.0], [2.0, 5.0]], order="F")
    lower, size, info = np.frombuffer(b"L", np.uint8), np.array([2]), np.array([0])
    DPOTRF(*(array.ctypes.data for array in (lower, size, matrix, size, info)))
    np.testing.assert_allclose(np.tril(matrix), [[2.0, 0.0], [1.0, 2.0]])
    assert info[0] == 0


@pytest.mark.parametrize("diagonals", [2, 3])
@pytest.mark.parametrize("size", [3, 40])
def test_banded_systems_have_the_bits_of_scipy(diagonals: int, size: int) -> None:
    rng = np.random.default_rng(size)
    bands = rng.normal(size=(diagonals, size))
    bands[-1] += 9.0
    right = rng.normal(size=(size, 2))
    given = bands.copy(), right.copy()
    np.testing.assert_array_equal(solve_positive_banded(bands, right), solveh_banded(bands, right))
    full = rng.normal(size=(3, size))
    found = solve_tridiagonal(full, right)
    np.testing.assert_array_equal(found, solve_banded((1, 1), full, right))
    for array, before in zip((bands, right), given, strict=True):
        np.testing.assert_array_equal(array, before)


@pytest.mark.parametrize("diagonals", [2, 3])
def test_banded_systems_without_a_solution(diagonals: int) -> None:
    bands, right = np.ones((diagonals, 5)), np.ones((5, 1))
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        solve_positive_banded(bands, right)
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        solve_tridiagonal(np.zeros((3, 5)), right)
    for array in (bands, right):
        array[0, 0] = np.nan
        with pytest.raises(ValueError, match="finite"):
            solve_positive_banded(bands, right)
        array[0, 0] = 0.0


@pytest.mark.parametrize("solve", [solve_positive_banded, solve_tridiagonal])
def test_systems_of_other_types_and_sizes(solve) -> None:
    bands, right = np.array([[0, 1, 1], [4, 4, 4], [1, 1, 0]]), np.array([[1], [2], [3]])
    bands = bands[:2] if solve is solve_positive_banded else bands
    expected = np.linalg.solve([[4, 1, 0], [1, 4, 1], [0, 1, 4]], right)
    for kind in (np.int64, np.float32):
        np.testing.assert_allclose(solve(bands.astype(kind), right.astype(kind)), expected)
    for wrong in (right[:2], right[:, 0], np.ones((4, 1)), right[None]):
        with pytest.raises(ValueError, match="do not fit"):
            solve(bands, wrong)


def test_systems_without_unknowns() -> None:
    assert solve_tridiagonal(np.zeros((3, 0)), np.zeros((0, 2))).shape == (0, 2)
    assert solve_positive_banded(np.zeros((3, 4)), np.zeros((4, 0))).shape == (4, 0)


def test_scipy_can_be_imported_afterwards() -> None:
    program = (
        "import sys, numpy as np\n"
        "from priorfill.runtime.lapack import solve_tridiagonal\n"
        "print(solve_tridiagonal(np.ones((3, 2)) * [[0], [2], [0]], np.ones((2, 1))).tolist())\n"
        "print('scipy.linalg' in sys.modules)\n"
        "import scipy.linalg.cython_lapack\n"
        "print(len(scipy.linalg.cython_lapack.__pyx_capi__) > 1000, scipy.linalg.det(np.eye(2)))\n"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.stdout.split("\n")[:3] == ["[[0.5], [0.5]]", "False", "True 1.0"], run.stderr


def test_routines_are_loaded_once_by_several_threads() -> None:
    program = (
        "import sys, numpy as np; from threading import Barrier; "
        "from concurrent.futures import ThreadPoolExecutor; "
        "from priorfill.runtime.lapack import solve_tridiagonal\n"
        "sys.setswitchinterval(1e-6); started = Barrier(8)\n"
        "def solve(bands):\n"
        "    started.wait(); return solve_tridiagonal(bands, np.ones((3, 1)))\n"
        "with ThreadPoolExecutor(8) as pool:\n"
        "    found = list(pool.map(solve, [np.ones((3, 3)) * [[0], [2], [0]]] * 8))\n"
        "assert all((one == 0.5).all() for one in found)\n"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr

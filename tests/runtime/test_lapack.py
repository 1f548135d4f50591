"""Routines of LAPACK called by their addresses, compared with SciPy's wrappers."""

from __future__ import annotations

import sys
import threading

import numpy as np
import pytest
from scipy.linalg.lapack import dpotrf, dtrtri

from priorfill.runtime.lapack import cholesky_in_place, invert_lower_in_place


def covariance(size: int) -> np.ndarray:
    x = np.random.default_rng(size).normal(size=(size, 7))
    return np.asfortranarray(x @ x.T + np.eye(size))


@pytest.mark.parametrize("size", [1, 2, 70])
def test_same_bits_as_the_wrappers_of_scipy(size: int) -> None:
    matrix = covariance(size)
    factor = dpotrf(matrix, lower=True, clean=True)[0]
    assert cholesky_in_place(matrix)
    np.testing.assert_array_equal(matrix, factor)
    assert invert_lower_in_place(matrix)
    np.testing.assert_array_equal(matrix, dtrtri(factor, lower=True)[0])


def test_matrices_without_a_result() -> None:
    assert not cholesky_in_place(np.asfortranarray([[1.0, 2.0], [2.0, 1.0]]))
    assert not invert_lower_in_place(np.asfortranarray([[0.0, 0.0], [1.0, 1.0]]))


@pytest.mark.parametrize(
    "matrix", [np.ones((2, 3), order="F"), np.ones((2, 2), dtype=np.float32), covariance(4)[::2]]
)
def test_other_arrays_are_refused(matrix: np.ndarray) -> None:
    with pytest.raises(ValueError, match="Fortran order"):
        cholesky_in_place(matrix)


def test_the_interpreter_lock_is_released() -> None:
    cholesky_in_place(covariance(2))
    matrix, done = covariance(800), []
    thread = threading.Thread(target=lambda: done.append(cholesky_in_place(matrix)))
    interval = sys.getswitchinterval()
    sys.setswitchinterval(10.0)  # the lock is only passed on where a thread gives it up
    try:
        thread.start()  # returns when the other thread gives it up
        assert not done
    finally:
        sys.setswitchinterval(interval)
        thread.join()
    assert done == [True]

"""Compiled calls of BLAS and LAPACK against NumPy and SciPy."""

from __future__ import annotations

import sys
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg.lapack import dpotrf

from priorfill.gp.triangular_kernels import (
    add_square,
    blas_work,
    factor,
    invert,
    multiply,
    whiten,
    whiten_twice,
)


def covariance(size: int, seed: int = 0) -> np.ndarray:
    x = np.random.default_rng(seed).normal(size=(size, 7))
    return x @ x.T + np.eye(size)


@pytest.mark.parametrize("size", [1, 2, 70])
def test_factors_have_the_bits_of_scipy(size: int) -> None:
    matrix = covariance(size)
    expected = dpotrf(matrix, lower=True, clean=True)[0]
    assert factor(matrix, len(matrix), blas_work())
    np.testing.assert_array_equal(np.triu(matrix).T, expected)


@given(st.integers(0, 2**31), st.integers(1, 20), st.integers(1, 6), st.integers(1, 5))
def test_products(seed: int, size: int, points: int, outputs: int) -> None:
    rng = np.random.default_rng(seed)
    root = np.tril(rng.normal(size=(size, size)))
    transposed = np.ascontiguousarray(root.T)
    transposed += np.tril(np.full((size, size), np.nan), -1)  # is not used
    rows, columns = rng.normal(size=(points, size)), rng.normal(size=(size, outputs))
    found = rows.copy()
    whiten(transposed, found, blas_work())
    np.testing.assert_allclose(found, rows @ root.T, atol=1e-12)
    found = columns.copy()
    whiten_twice(transposed, found, blas_work())
    np.testing.assert_allclose(found, root.T @ (root @ columns), atol=1e-11)
    product = np.empty((points, outputs))
    multiply(rows, columns, product, blas_work())
    np.testing.assert_allclose(product, rows @ columns, atol=1e-12)


def test_only_the_upper_triangle_is_used() -> None:
    matrix = covariance(130)
    expected = np.linalg.inv(np.linalg.cholesky(matrix).T)
    matrix[np.tril_indices(130, -1)] = np.nan
    assert factor(matrix, len(matrix), blas_work())
    assert invert(matrix, len(matrix), blas_work())
    np.testing.assert_allclose(np.triu(matrix), expected, atol=1e-10)
    assert np.isnan(matrix[np.tril_indices(130, -1)]).all()


def test_a_part_of_a_matrix() -> None:
    whole = covariance(9)
    expected = np.linalg.inv(np.linalg.cholesky(whole[:5, :5]).T)
    assert factor(whole, 5, blas_work())
    assert invert(whole, 5, blas_work())
    np.testing.assert_allclose(np.triu(whole[:5, :5]), expected, atol=1e-12)
    np.testing.assert_array_equal(whole[5:], covariance(9)[5:])
    rows, total = np.random.default_rng(0).normal(size=(4, 6)), np.zeros((3, 7))
    add_square(rows, (3, 5), total, blas_work())
    np.testing.assert_allclose(total[:, :3], np.triu(rows[:3, :5] @ rows[:3, :5].T), atol=1e-12)
    assert not total[:, 3:].any()


def test_matrices_without_a_result() -> None:
    assert not factor(np.array([[1.0, 2.0], [2.0, 1.0]]), 2, blas_work())
    assert not invert(np.array([[0.0, 1.0], [0.0, 1.0]]), 2, blas_work())
    singular = np.eye(130)
    singular[3, 3] = 0.0
    assert not invert(singular, len(singular), blas_work())


def test_the_interpreter_lock_is_released() -> None:
    factor(covariance(2), 2, blas_work())
    matrix, done = covariance(800), []
    thread = threading.Thread(target=lambda: done.append(factor(matrix, len(matrix), blas_work())))
    interval = sys.getswitchinterval()
    sys.setswitchinterval(10.0)  # the lock is only passed on where a thread gives it up
    try:
        thread.start()  # returns when the other thread gives it up
        assert not done
    finally:
        sys.setswitchinterval(interval)
        thread.join()
    assert done == [True]

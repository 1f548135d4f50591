"""Rotations that superpose points, compared with singular values from LAPACK."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from priorfill.geometry.rotation_kernels import nearest_rotations

RNG = np.random.default_rng(0)
MATRICES = RNG.normal(size=(500, 3, 3))
ONE, OTHER = RNG.normal(size=(2, 100, 3))


def rotations(matrices: np.ndarray) -> np.ndarray:
    result = np.empty_like(matrices)
    nearest_rotations(matrices, result)
    return result


def by_singular_values(matrices: np.ndarray) -> np.ndarray:
    """The same, as Kabsch gives it."""
    u, _, vt = np.linalg.svd(matrices)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    return u @ vt


@pytest.mark.parametrize(
    "matrices",
    [
        MATRICES,
        MATRICES * [1e5, 1.0, 1e-2],
        RNG.normal(size=(500, 3, 2)) @ RNG.normal(size=(500, 2, 3)),  # points in a plane
        -np.eye(3) * RNG.uniform(1.0, 2.0, (500, 1, 3)) + RNG.normal(0.0, 0.1, (500, 3, 3)),
    ],
    ids=["random", "scaled", "planar", "reflections"],
)
def test_agree_with_singular_values(matrices: np.ndarray) -> None:
    found = rotations(matrices)
    np.testing.assert_allclose(found, by_singular_values(matrices), atol=1e-10)
    np.testing.assert_allclose(np.linalg.det(found), 1.0, atol=1e-13)


def test_points_on_a_line_are_superposed() -> None:
    matrices = ONE[:, :, None] * OTHER[:, None, :]
    found = rotations(matrices)
    largest = np.linalg.svd(matrices)[1][:, 0]
    np.testing.assert_allclose(np.einsum("fij,fij->f", found, matrices), largest, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.det(found), 1.0, atol=1e-13)


def test_no_extent_gives_no_rotation() -> None:
    np.testing.assert_array_equal(rotations(np.zeros((1, 3, 3)))[0], np.eye(3))


def test_rotations_do_not_depend_on_the_scale() -> None:
    for exponent in (-1000, 1000):
        scaled = np.ldexp(MATRICES[:9], exponent)
        np.testing.assert_array_equal(rotations(scaled), rotations(MATRICES[:9]))


def test_rotations_of_unknown_points_are_unknown() -> None:
    matrices = MATRICES[:2].copy()
    matrices[0, 2, 2] = np.nan
    assert np.isnan(rotations(matrices)).any(axis=(1, 2)).tolist() == [True, False]


def test_bits_are_the_same_on_every_system() -> None:
    found = rotations(np.round(MATRICES, 6))
    assert hashlib.sha256(found.tobytes()).hexdigest()[:16] == "0e222d7ef55c5224"

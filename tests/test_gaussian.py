"""What Gaussian processes share."""

from __future__ import annotations

import numpy as np

from priorfill.gaussian import shares, squared_distances


def test_squared_distances() -> None:
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(7, 4)), rng.normal(size=(5, 4))
    found = squared_distances(one @ other.T, (one**2).sum(axis=1), (other**2).sum(axis=1))
    for i in range(7):
        for j in range(5):
            assert np.isclose(found[i, j], np.linalg.norm(one[i] - other[j]) ** 2)
    large = 1e6 + rng.normal(size=(6, 4))
    product = large @ large.T
    assert squared_distances(product, np.diag(product), np.diag(product)).min() >= 0.0


def test_shares() -> None:
    np.testing.assert_allclose(shares(np.array([1.0, 2.0]), 2.0), [0.8, 0.2])
    np.testing.assert_allclose(shares(np.array([1.0, 2.0, 9.0]), 0.0), 1.0 / 3.0)
    error = np.random.default_rng(0).uniform(1.0, 9.0, size=(4, 6))
    share = shares(error, 8.0)
    np.testing.assert_allclose(share.sum(axis=0), 1.0)
    for marker in range(6):
        np.testing.assert_allclose(share[:, marker], shares(error[:, marker], 8.0))

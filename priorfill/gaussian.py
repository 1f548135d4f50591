"""What Gaussian processes share: distances of features, and how several of them are mixed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["shares", "squared_distances"]


def squared_distances(
    product: NDArray[np.float64], one: NDArray[np.float64], other: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return squared distances of features, none below 0 by rounding [shape=(a, b)].

    Parameters
    ----------
    product : ndarray [shape=(a, b)]
        Inner products of the features.
    one, other : ndarray [shapes=(a,), (b,)]
        Inner product of each with itself.
    """
    square: NDArray[np.float64] = np.maximum(one[:, None] + other - 2.0 * product, 0.0)
    return square


def shares(error: NDArray[np.float64], power: float) -> NDArray[np.float64]:
    """Return how much each of several ways to predict counts in their mixture.

    Parameters
    ----------
    error : ndarray [shape=(ways, ...)]
        Of each, above 0.
    power : float
        They count as (least error / own error) to this: between the mean of all (0) and the
        best alone (infinite).

    Returns
    -------
    ndarray [shape as given]
        Sum 1 over the ways.
    """
    share: NDArray[np.float64] = (error.min(axis=0) / error) ** power
    share /= share.sum(axis=0)
    return share

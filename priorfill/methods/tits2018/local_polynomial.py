"""LPR, local polynomial regression: the marker in its triad's frame from the triad's shape.

Least squares on a constant and all products of one and two of the shape's three numbers.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.tits2018.scaling import Scale

__all__ = ["predict", "products"]

Array = NDArray[np.float64]

DEGREE = 2
"""Factors of a product, at most."""


def products(features: Array) -> Array:
    """Return all products of up to `DEGREE` columns, with repetition [shape=(rows, products)]."""
    columns = range(features.shape[1])
    chosen = [
        combination
        for degree in range(1, DEGREE + 1)
        for combination in combinations_with_replacement(columns, degree)
    ]
    return np.stack([features[:, list(one)].prod(axis=1) for one in chosen], axis=1)


def predict(features: Array, local: Array, asked: Array, scaled_by: Array) -> Array:
    """Predict local coordinates by a polynomial of the triad's shape.

    Parameters
    ----------
    features : ndarray [shape=(rows, 3), mm]
        Shape of the triad in the frames to learn from.
    local : ndarray [shape=(rows, 3), mm]
        The marker in these frames.
    asked : ndarray [shape=(asked, 3), mm]
        Shape in the frames asked for; NaN where missing.
    scaled_by : ndarray [shape=(frames, 3), mm]
        All shapes that are known: the products are scaled by these.

    Returns
    -------
    ndarray [shape=(asked, 3), mm]
        NaN where the shape is missing.
    """
    scale, target = Scale.of(products(scaled_by)), Scale.of(local)
    known = ~np.isnan(asked).any(axis=1)
    out = np.full(asked.shape, np.nan)

    def design(shape: Array) -> Array:
        return np.column_stack([np.ones(len(shape)), scale.down(products(shape))])

    coefficients = np.linalg.lstsq(design(features), target.down(local), rcond=None)[0]
    out[known] = target.up(design(asked[known]) @ coefficients)
    return out

"""Local polynomial regression (``lpr``) of a marker, in its triad's frame, on the triad's shape.

Least squares on a constant and on all products of one and two of the three features of the shape.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.tits2018.scaling import Scale

__all__ = ["predict", "products"]

Array = NDArray[np.float64]

DEGREE = 2
"""Degree of the polynomial."""


def products(features: Array) -> Array:
    """Return all monomials of degree 1 to `DEGREE` of the columns [shape=(rows, monomials)]."""
    columns = range(features.shape[1])
    chosen = [
        combination
        for degree in range(1, DEGREE + 1)
        for combination in combinations_with_replacement(columns, degree)
    ]
    return np.stack([features[:, list(one)].prod(axis=1) for one in chosen], axis=1)


def predict(features: Array, local: Array, query: Array, scaled_by: Array) -> Array:
    """Predict local coordinates by a polynomial of the triad's shape.

    Parameters
    ----------
    features : ndarray [shape=(rows, 3), mm]
        Shape of the triad in the training frames.
    local : ndarray [shape=(rows, 3), mm]
        The marker's local position in these frames.
    query : ndarray [shape=(query frames, 3), mm]
        Shape in the frames to predict; NaN where missing.
    scaled_by : ndarray [shape=(frames, 3), mm]
        All known shapes, by which the monomials are scaled.

    Returns
    -------
    ndarray [shape=(query frames, 3), mm]
        NaN where the shape is missing.
    """
    scale, target = Scale.of(products(scaled_by)), Scale.of(local)
    known = ~np.isnan(query).any(axis=1)
    out = np.full(query.shape, np.nan)

    def design(shape: Array) -> Array:
        return np.column_stack([np.ones(len(shape)), scale.down(products(shape))])

    coefficients = np.linalg.lstsq(design(features), target.down(local), rcond=None)[0]
    out[known] = target.up(design(query[known]) @ coefficients)
    return out

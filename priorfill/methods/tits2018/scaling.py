"""Scaling of features and targets to mean 0 and standard deviation 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Scale"]

Array = NDArray[np.float64]

MIN_RELATIVE_SD = 1e-12
"""Standard deviation, relative to the largest value, below which a column counts as constant."""


@dataclass(frozen=True, eq=False)
class Scale:
    """Mean and standard deviation of each column.

    Attributes
    ----------
    mean, sd : ndarray [shape=(columns,)]
        The standard deviation of a constant column is 0.
    """

    mean: Array
    sd: Array

    @classmethod
    def of(cls, rows: Array) -> Scale:
        """Return the scale of one or more rows [shape=(rows, columns)] without NaN."""
        mean = rows.mean(axis=0)
        if len(rows) == 1:
            return cls(mean, np.zeros(rows.shape[1]))
        sd = rows.std(axis=0, ddof=1)
        constant = sd <= MIN_RELATIVE_SD * np.abs(rows).max(axis=0)
        return cls(mean, np.where(constant, 0.0, sd))

    def down(self, rows: Array) -> Array:
        """Return scaled rows; constant columns become 0."""
        varies = self.sd > 0.0
        return np.where(varies, (rows - self.mean) / np.where(varies, self.sd, 1.0), 0.0)

    def up(self, rows: Array) -> Array:
        """Return the rows that `down` would scale to these."""
        return rows * self.sd + self.mean

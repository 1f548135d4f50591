"""Scaling of features and of what is asked for to mean 0 and standard deviation 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Scale"]

Array = NDArray[np.float64]

ROUNDING = 1e-12
"""Share of the largest value below which a spread is rounding: the column is constant."""


@dataclass(frozen=True, eq=False)
class Scale:
    """Mean and standard deviation of each column.

    Attributes
    ----------
    mean, deviation : ndarray [shape=(columns,)]
        The deviation of a constant column is 0.
    """

    mean: Array
    deviation: Array

    @classmethod
    def of(cls, rows: Array) -> Scale:
        """Return the scale of rows [shape=(rows, columns)] without NaN, one at least."""
        mean = rows.mean(axis=0)
        if len(rows) == 1:
            return cls(mean, np.zeros(rows.shape[1]))
        deviation = rows.std(axis=0, ddof=1)
        constant = deviation <= ROUNDING * np.abs(rows).max(axis=0)
        return cls(mean, np.where(constant, 0.0, deviation))

    def down(self, rows: Array) -> Array:
        """Scale rows; constant columns become 0."""
        varies = self.deviation > 0.0
        return np.where(varies, (rows - self.mean) / np.where(varies, self.deviation, 1.0), 0.0)

    def up(self, rows: Array) -> Array:
        """Undo `down`."""
        return rows * self.deviation + self.mean

"""How missing markers are tied to the visible ones, and what tells one body from another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Ties"]

FIRM = 5.0
"""mm. Distances that vary by this much count half as much in the shape of a body."""

SHAPE_REACH = 300.0
"""mm. Markers at this distance D from the missing one count exp(-1/2) in the shape."""


@dataclass(frozen=True, eq=False)
class Ties:
    """How the missing markers are tied to the visible ones.

    Attributes
    ----------
    distance, spread : ndarray [shape=(visible markers,), mm]
        Rms distance of each visible marker to the nearest missing one, and how much it varies.
    inner : ndarray [shape=(visible markers, visible markers), mm]
        How much the distances of the visible ones vary.
    """

    distance: NDArray[np.float64]
    spread: NDArray[np.float64]
    inner: NDArray[np.float64]

    def shape(self, visible: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what tells one body from another: its mean distances, weighted.

        The difference of two of them has the length of the rms difference (mm) of the distances,
        those counting most that vary least and are near the missing markers.
        """
        one, other = np.triu_indices(len(self.distance), 1)
        near = np.exp(-0.25 * (self.distance / SHAPE_REACH) ** 2)
        weight = near[one] * near[other] / (1.0 + (self.inner[one, other] / FIRM) ** 2)
        weight /= weight.sum()
        between = np.linalg.norm(visible[:, one] - visible[:, other], axis=2).mean(axis=0)
        result: NDArray[np.float64] = np.sqrt(weight) * between
        return result

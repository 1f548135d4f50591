"""Coupling of the missing markers to the visible ones, and the shape of a body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.gpr.dropout.options import DropoutOptions
from priorfill.runtime.elementary import exp

__all__ = ["MarkerCoupling"]


@dataclass(frozen=True, eq=False)
class MarkerCoupling:
    """Coupling of the missing markers to the visible ones: how near, and how rigid.

    Attributes
    ----------
    distance, spread : ndarray [shape=(visible markers,), mm]
        Rms distance of each visible marker to the nearest missing one, and its standard deviation.
    visible_spread : ndarray [shape=(visible markers, visible markers), mm]
        Standard deviations of the distances of the visible markers from each other.
    """

    distance: NDArray[np.float64]
    spread: NDArray[np.float64]
    visible_spread: NDArray[np.float64]

    def body_shape(
        self, visible: NDArray[np.float64], options: DropoutOptions
    ) -> NDArray[np.float64]:
        """Return the shape of a body: weighted mean distances of its visible markers.

        The norm of the difference of two shapes is the weighted rms difference (mm) of the
        distances. Pairs that are rigid, and near the missing markers, have the greatest weights.

        Parameters
        ----------
        visible : ndarray [shape=(poses, visible markers, 3), mm]
            Poses of the body.
        options : DropoutOptions
            `shape_length_scale` and `shape_rigidity_scale`.

        Returns
        -------
        ndarray [shape=(pairs of visible markers,), mm]
        """
        one, other = np.triu_indices(len(self.distance), 1)
        near = exp(-0.25 * (self.distance / options.shape_length_scale) ** 2)
        spread = self.visible_spread[one, other]
        weight = near[one] * near[other] / (1.0 + (spread / options.shape_rigidity_scale) ** 2)
        weight /= max(weight.sum(), np.finfo(float).tiny)  # metres away, all weights may be 0
        between = np.linalg.norm(visible[:, one] - visible[:, other], axis=2).mean(axis=0)
        result: NDArray[np.float64] = np.sqrt(weight) * between
        return result

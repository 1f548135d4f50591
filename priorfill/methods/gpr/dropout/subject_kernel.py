"""What bodies have in common: the covariance of poses of several bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["KINDS", "Kin"]


@dataclass(frozen=True)
class Kin:
    """What bodies have in common: a kernel for rows of several bodies.

    The covariance of two rows with features f, f' is ``1 + k + b (offset + movement k)`` with
    ``k = linear f . f' + radial exp(-|f - f'|² / 2 length²)``, and b what their bodies share:
    ``shape exp(-|d|² / 2 reach²) + image [same body, in a mirror or not] + rest [same]``, d the
    difference of their shapes; the three parts sum to 1.

    Attributes
    ----------
    linear, radial, length : float
        As in `priorfill.gp.ensemble.Kernel`.
    offset, movement : float
        Variance of what a body is off by, and how much of k is its own.
    shape, image : float
        Parts of that which are shared by bodies of the same shape, and by a body and its image.
    reach : float
        mm; how similar shapes are that share much.
    noise : float
        Variance that rows do not share with anything.
    """

    linear: float
    radial: float
    length: float
    offset: float
    movement: float
    shape: float
    image: float
    reach: float
    noise: float

    def similarity(
        self, product: NDArray[np.float64], square: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return k of poses by inner product and squared distance of their features."""
        result: NDArray[np.float64] = self.linear * product
        result += self.radial * np.exp(-0.5 / self.length**2 * square)
        return result

    def covariance(
        self, alike: NDArray[np.float64], shared: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the covariance of poses, without noise.

        Parameters
        ----------
        alike : ndarray [shape=(a, b)]
            k of each pair of them, from `similarity`.
        shared : ndarray [shape=(a, b) or (b,)]
            b of their witnesses, from `shared`.
        """
        result: NDArray[np.float64] = 1.0 + alike
        result += shared * (self.offset + self.movement * alike)
        return result

    def shared(
        self,
        shapes: NDArray[np.float64],
        body: NDArray[np.intp],
        mirrored: NDArray[np.bool_],
    ) -> NDArray[np.float64]:
        """Return b of each pair of witnesses."""
        square = ((shapes[:, None] - shapes) ** 2).sum(axis=2)
        one = body[:, None] == body
        same = one & (mirrored[:, None] == mirrored)
        rest = 1.0 - self.shape - self.image
        result: NDArray[np.float64] = self.shape * np.exp(-0.5 / self.reach**2 * square)
        result += self.image * one + rest * same
        return result


KINDS = (
    Kin(1.0, 1.0, 0.6, 0.2, 0.2, 0.75, 0.20, 30.0, 0.1),
    Kin(0.1, 2.0, 0.6, 0.2, 0.2, 0.80, 0.10, 30.0, 0.1),
)
"""Members: each view with each of these. Chosen on 92 markers taken out of takes of other people;
members that trust the mirror image more do no better."""

"""Covariance functions of the Gaussian processes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Kernel"]

FADED = 0.5
"""What is left of the covariance of poses far apart in time, for kernels that fade."""


@dataclass(frozen=True)
class Kernel:
    """Covariance of two poses, features scaled to a mean square norm of 1.

    Attributes
    ----------
    linear, radial : float
        Parts of the linear and of the radial covariance.
    length : float
        Length scale of the radial part.
    temporal : float
        Part of the covariance that decays with time.
    seconds : float
        Its time scale.
    smooth : bool
        Decay (1 + r) exp(-r), r = √3 |dt| / seconds, which continues velocities; else
        exp(-|dt| / seconds), which continues positions.
    noise : float
        Variance that rows do not share with anything.
    fading : float, optional
        s; how fast poses far apart in time lose what they have in common, down to `FADED`:
        markers slip, and movements change. By default they do not.
    """

    linear: float
    radial: float
    length: float
    temporal: float
    seconds: float
    smooth: bool
    noise: float
    fading: float | None = None

    def memory(self, lag: NDArray[np.float64]) -> NDArray[np.float64] | float:
        """Factor of the covariance of poses some time apart [shape=(a, b), s]."""
        if self.fading is None:
            return 1.0
        kept: NDArray[np.float64] = FADED + (1.0 - FADED) * np.exp(-lag / self.fading)
        return kept

    def decay(self, lag: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariance of the temporal part.

        Parameters
        ----------
        lag : ndarray [shape=(a, b), s]
            Time between poses; infinite for those of different recordings.
        """
        if not self.smooth:
            exponential: NDArray[np.float64] = self.temporal * np.exp(-lag / self.seconds)
            return exponential
        # the exponential of more is 0, and infinity times 0 is not
        scaled = np.minimum(np.sqrt(3.0) / self.seconds * lag, 700.0)
        matern: NDArray[np.float64] = self.temporal * (1.0 + scaled) * np.exp(-scaled)
        return matern

    def covariance(
        self,
        product: NDArray[np.float64],
        square: NDArray[np.float64],
        decay: NDArray[np.float64],
        correlation: NDArray[np.float64] | float = 1.0,
    ) -> NDArray[np.float64]:
        """Covariance, without noise, of poses.

        Parameters
        ----------
        product, square : ndarray [shape=(a, b)]
            Inner product and squared distance of their features.
        decay : ndarray [shape=(a, b)]
            Covariance of the temporal part.
        correlation : ndarray [shape=(a, b)] or float
            Of the recordings that the poses are from; holds for all but the temporal part.
        """
        return self.combined(product, self.nearness(square), decay, correlation)

    def nearness(self, square: NDArray[np.float64]) -> NDArray[np.float64]:
        """Radial part of the covariance, in units of its own, by squared distances."""
        near: NDArray[np.float64] = np.exp(square * (-0.5 / self.length**2))
        return near

    def combined(
        self,
        product: NDArray[np.float64],
        nearness: NDArray[np.float64],
        decay: NDArray[np.float64],
        correlation: NDArray[np.float64] | float = 1.0,
    ) -> NDArray[np.float64]:
        """Covariance, without noise, by `nearness`, which kernels of one length have in common.

        Other parameters are those of `covariance`.
        """
        covariance: NDArray[np.float64] = self.linear * product
        covariance += 1.0
        if self.radial:
            covariance += self.radial * nearness
        if not isinstance(correlation, float) or correlation != 1.0:  # mostly it is
            covariance *= correlation
        covariance += decay
        return covariance

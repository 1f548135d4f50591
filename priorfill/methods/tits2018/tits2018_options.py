"""All constants of Tits et al. 2018, with the values of the published program."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.gloersen2016.strategies import Gloersen2016Options
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = ["Tits2018Options", "spread_evenly", "thinned"]


@dataclass(frozen=True)
class Tits2018Options:
    """Options of the methods of Tits et al. 2018; the defaults are those of their program.

    Attributes
    ----------
    min_presence : float
        Markers visible in a smaller share of the frames are neither filled nor used.
    window : float
        s. Length of the moving median and mean.
    min_complete_frames : int
        With more complete frames than this, the variation of distances is measured in these alone.
    max_distance_frames : int
        Maximum number of frames in which the variation of distances is measured.
    max_distance_sd : float
        mm. The global regression uses markers whose distance from the missing one has at most this
        standard deviation, or all markers where there is none.
    global_rows, local_rows, density_rows : int
        Training frames of the global regression and of the local models, and distances from which
        the densities are estimated. See `thinned`.
    half_weight_distance : float
        Distance between shapes, in standard deviations of their features, at which a frame's weight
        in ``lgrnn`` is one half.
    low_quantile, high_quantile : float
        Quantiles of the measured distances between which distances are constrained.
    rounds : int
        Maximum number of times that each of the three distances is constrained.
    pca : Gloersen2016Options
        Weights and number of components of the weighted PCA; the program uses the constants of
        Gløersen and Federolf 2016.

    Raises
    ------
    OptionError
        Where a value is outside its range.
    """

    min_presence: float = 0.3
    window: float = 0.07
    min_complete_frames: int = 300
    max_distance_frames: int = 5000
    max_distance_sd: float = 50.0
    global_rows: int = 500
    local_rows: int = 1000
    density_rows: int = 500
    half_weight_distance: float = 0.3
    low_quantile: float = 0.01
    high_quantile: float = 0.99
    rounds: int = 5
    pca: Gloersen2016Options = field(default_factory=Gloersen2016Options)

    def __post_init__(self) -> None:
        check_between(self, 0.0, 1.0, "min_presence", "low_quantile", "high_quantile")
        check_at_least(self, 0, "window", "min_complete_frames", "max_distance_sd", "rounds")
        check_at_least(self, 2, "max_distance_frames", "global_rows", "local_rows", "density_rows")
        check_at_least(self, MIN_HALF_WEIGHT_DISTANCE, "half_weight_distance")


MIN_HALF_WEIGHT_DISTANCE = 1e-6
"""Smallest `Tits2018Options.half_weight_distance`, which is a divisor."""


def thinned(count: int, enough: int) -> NDArray[np.intp]:
    """Choose training rows as the published program does.

    Fewer than ``enough`` rows are all used. Of twice as many or more, every n-th row is used, with
    the largest n that leaves at least ``enough``. Between the two the program draws ``enough`` rows
    at random; here they are spread evenly, so that the result is reproducible.

    Parameters
    ----------
    count : int
        Number of rows.
    enough : int
        Number of rows that suffice.

    Returns
    -------
    ndarray of int [shape=(chosen,)]
        Indices in ascending order.

    Examples
    --------
    >>> thinned(7, 3)
    array([0, 2, 4, 6])
    """
    if count < enough:
        return np.arange(count)
    if count < 2 * enough:
        return spread_evenly(count, enough)
    return np.arange(0, count, count // enough)


def spread_evenly(count: int, max_rows: int) -> NDArray[np.intp]:
    """Return the indices of at most ``max_rows`` of ``count`` rows, evenly spaced."""
    if count <= max_rows:
        return np.arange(count)
    return np.linspace(0, count - 1, max_rows).round().astype(np.intp)

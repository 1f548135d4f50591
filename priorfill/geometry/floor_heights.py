"""Find the height of the floor below each marker, from where the markers rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["FloorHeightOptions", "floor_heights", "is_stood_on"]


@dataclass(frozen=True)
class FloorHeightOptions:
    """What counts as resting on the floor.

    Attributes
    ----------
    lowest_percentile : float
        Percentile of a marker's heights taken as its lowest height: single samples may be wrong,
        or taken while the foot pressed into a soft floor.
    min_samples : int
        Measured samples that a marker needs.
    rest_tolerance : float
        mm. A marker rests while it is at most this far above its lowest height.
    min_rest_share : float
        Fraction of its samples in which a marker must rest for the floor to be what stops it. Feet
        stand during a good part of any clip, whereas a marker that swings past its lowest point
        stays there only for moments.
    max_height : float
        mm. The lowest height of a marker that rests on the floor, above that of the lowest marker
        of all. The ankle's is 90 to 100 mm.
    max_rest_speed : float
        mm/s. Greatest vertical speed of a marker that stands still. Feet on a treadmill move
        horizontally. In 43 real recordings some marker is slower near its lowest height during
        11 % of its samples or more; of 1,000 random rigid bodies in free flight, 11 have a marker
        that is slower during `min_rest_share` of them.
    speed_seconds : float
        s. Least time over which that speed is measured: the noise of shorter times hides it.
    """

    lowest_percentile: float = 1.0
    min_samples: int = 30
    rest_tolerance: float = 10.0
    min_rest_share: float = 0.04
    max_height: float = 150.0
    max_rest_speed: float = 50.0
    speed_seconds: float = 0.05


def floor_heights(
    positions: NDArray[np.float64],
    contralateral: NDArray[np.intp],
    options: FloorHeightOptions = FloorHeightOptions(),
) -> NDArray[np.float64]:
    """Find the height at which the floor stops each marker.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Upright (+Z up), NaN where missing.
    contralateral : ndarray of int [shape=(markers,)]
        Each marker's counterpart on the other side of the body; -1 where it has none.
    options : FloorHeightOptions

    Returns
    -------
    ndarray [shape=(markers,), mm]
        Minus infinity where neither the marker nor its counterpart is seen to rest on the floor.

    See Also
    --------
    is_stood_on : Check whether a marker stands still at such a height.

    Examples
    --------
    >>> positions = np.zeros((100, 2, 3))
    >>> positions[:, 0, 2], positions[:, 1, 2] = 20.0, 900.0  # a toe and a hip
    >>> floor_heights(positions, np.array([-1, -1]))
    array([ 20., -inf])
    """
    count = positions.shape[1]
    lowest, rests = np.full(count, np.inf), np.zeros(count, dtype=bool)
    for marker in range(count):
        heights = positions[:, marker, 2]
        heights = heights[~np.isnan(heights)]
        if len(heights) >= options.min_samples:
            lowest[marker] = np.percentile(heights, options.lowest_percentile)
            resting = heights <= lowest[marker] + options.rest_tolerance
            rests[marker] = resting.mean() >= options.min_rest_share
    ground = lowest.min(initial=np.inf)
    rests &= lowest <= ground + options.max_height
    # both feet of a subject have the same height; the lower one of the two is the safer limit
    other_side = np.where(
        (contralateral >= 0) & rests[contralateral], lowest[contralateral], np.inf
    )
    floor: NDArray[np.float64] = np.where(
        rests | np.isfinite(other_side), np.minimum(lowest, other_side), -np.inf
    )
    return floor


def is_stood_on(
    positions: NDArray[np.float64],
    floor: NDArray[np.float64],
    rate: float,
    options: FloorHeightOptions = FloorHeightOptions(),
) -> bool:
    """Check whether some marker stands still at the height where the floor stops it.

    A body in free flight has lowest heights, too, but passes them.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Upright (+Z up), NaN where missing.
    floor : ndarray [shape=(markers,), mm]
        The heights that `floor_heights` found.
    rate : float
        Hz.
    options : FloorHeightOptions

    Returns
    -------
    bool

    See Also
    --------
    floor_heights : Find the heights.

    Examples
    --------
    >>> positions = np.zeros((100, 1, 3))
    >>> is_stood_on(positions, np.zeros(1), 100.0)
    True
    >>> positions[:, 0, 2] = 2.0 * np.arange(100)  # 200 mm/s
    >>> is_stood_on(positions, np.zeros(1), 100.0)
    False
    """
    step = max(round(options.speed_seconds * rate), 1)
    for marker in np.flatnonzero(np.isfinite(floor)):
        frames = np.flatnonzero(~np.isnan(positions[:, marker, 2]))
        heights = positions[frames, marker, 2]
        # every second frame may be blank: the next measured sample after the least time
        later = np.searchsorted(frames, frames + step)
        earlier = np.flatnonzero(later < len(frames))
        later = later[earlier]
        speed = np.abs(heights[later] - heights[earlier]) * rate / (frames[later] - frames[earlier])
        still = (heights[earlier] <= floor[marker] + options.rest_tolerance) & (
            speed <= options.max_rest_speed
        )
        if still.any() and still.sum() >= options.min_rest_share * len(frames):
            return True
    return False

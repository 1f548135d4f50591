"""Sums and maxima over a window that moves along time.

SciPy has them in `scipy.ndimage`, whose import takes as long as many a fill.
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["running_maximum", "symmetric_filter"]

_Number = TypeVar("_Number", bound=np.generic)


def running_maximum(values: NDArray[_Number], reach: int) -> NDArray[_Number]:
    """Return the greatest value within some frames before and after each frame.

    Parameters
    ----------
    values : ndarray [shape=(frames, ...)]
        At least one frame.
    reach : int
        Frames before, and frames after; fewer at the ends.

    Returns
    -------
    ndarray [shape=(frames, ...)]

    See Also
    --------
    symmetric_filter : A weighted sum over such a window.

    Examples
    --------
    >>> import numpy as np
    >>> running_maximum(np.array([1, 5, 2, 0, 0]), 1)
    array([5, 5, 5, 2, 0])
    """
    at = np.arange(len(values))
    covered = 0
    while covered < reach:  # three windows of 2 c + 1 frames that touch make one of 6 c + 3
        step = min(reach - covered, 2 * covered + 1)
        before, after = values[np.maximum(at - step, 0)], values[np.minimum(at + step, at[-1])]
        values = np.maximum(values, np.maximum(before, after))
        covered += step
    return values


def symmetric_filter(
    values: NDArray[np.float64], taps: NDArray[np.float64], wanted: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Return some samples of a signal filtered with symmetric taps.

    Parameters
    ----------
    values : ndarray [shape=(frames, ...)]
        With samples for all taps around each wanted one.
    taps : ndarray [shape=(taps,)]
        Odd in number, the same from both ends.
    wanted : ndarray of int [shape=(samples,)]
        Evenly spaced, ascending.

    Returns
    -------
    ndarray [shape=(samples, ...)]

    See Also
    --------
    running_maximum : The greatest value in such a window.

    Examples
    --------
    >>> import numpy as np
    >>> ramp = np.arange(7.0)
    >>> symmetric_filter(ramp, np.array([0.25, 0.5, 0.25]), np.array([1, 3, 5]))
    array([1., 3., 5.])
    """
    half = len(taps) // 2
    if not len(wanted):
        return values[:0]
    first, last = int(wanted[0]), int(wanted[-1])
    step = int(wanted[1]) - first if len(wanted) > 1 else 1

    def shifted(by: int) -> Any:
        return values[first + by : last + by + 1 : step]

    result: NDArray[np.float64] = taps[half] * shifted(0)
    pair = np.empty_like(result)
    for by in range(1, half + 1):
        np.add(shifted(-by), shifted(by), out=pair)
        pair *= taps[half + by]
        result += pair
    return result

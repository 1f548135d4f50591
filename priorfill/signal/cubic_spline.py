"""Cubic splines through samples.

Those of `scipy.interpolate`, whose import takes as long as many a fill.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.lapack import solve_tridiagonal

__all__ = ["cubic_spline"]

_Floats = NDArray[np.float64]

MIN_KNOTS = 4
"""Knots of a spline whose first and last two pieces are one cubic each (not-a-knot)."""


def cubic_spline(
    knots: NDArray[np.floating | np.integer],
    values: _Floats,
    query: NDArray[np.floating | np.integer],
    *,
    natural: bool = False,
) -> _Floats:
    """Interpolate samples by a cubic spline.

    Parameters
    ----------
    knots : ndarray [shape=(knots,)]
        Times of the samples, ascending; at least two.
    values : ndarray [shape=(knots, ...)]
        The samples.
    query : ndarray [shape=(times,)]
        Times to interpolate at; beyond the ends the first and last cubic are continued.
    natural : bool
        Whether the second derivative is zero at the ends. Otherwise the third one is continuous at
        the second and the last but one knot (not-a-knot); a parabola goes through three knots.

    Returns
    -------
    ndarray [shape=(times, ...)]

    Notes
    -----
    The slopes at the knots solve a tridiagonal system (de Boor, A Practical Guide to Splines,
    chapter IV).

    Examples
    --------
    >>> import numpy as np
    >>> cubic_spline(np.arange(5), np.arange(5.0) ** 3, np.array([0.5, 2.5]))
    array([ 0.125, 15.625])
    """
    times = np.asarray(knots, dtype=np.float64)
    at = np.asarray(query, dtype=np.float64)
    rows = values.reshape(len(times), -1)
    if not natural and len(times) < MIN_KNOTS:
        found = _lagrange(times, rows, at)
        return found.reshape(len(at), *values.shape[1:])
    width = np.diff(times)[:, None]
    secant = np.diff(rows, axis=0) / width
    slopes = _slopes(times, rows, natural=natural)
    bend = (slopes[:-1] + slopes[1:] - 2.0 * secant) / width
    piece = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    t = (at - times[piece])[:, None]
    square = ((secant - slopes[:-1]) / width - bend)[piece] + t * (bend / width)[piece]
    found = rows[piece] + t * (slopes[piece] + t * square)
    return found.reshape(len(at), *values.shape[1:])


def _slopes(times: _Floats, rows: _Floats, *, natural: bool) -> _Floats:
    """Return the first derivatives at the knots [shape=(knots, columns)]."""
    width = np.diff(times)
    secant = np.diff(rows, axis=0) / width[:, None]
    bands = np.zeros((3, len(times)))
    right = np.empty_like(rows)
    bands[1, 1:-1] = 2.0 * (width[:-1] + width[1:])
    bands[0, 2:] = width[:-1]
    bands[2, :-2] = width[1:]
    right[1:-1] = 3.0 * (width[1:, None] * secant[:-1] + width[:-1, None] * secant[1:])
    # at each end: its row of the matrix, and the widths and secants from it inwards
    for end, beside, w, s in (
        ((1, 0), (0, 1), width, secant),
        ((1, -1), (2, -2), width[::-1], secant[::-1]),
    ):
        if natural:
            bands[end], bands[beside] = 2.0 * w[0], w[0]
            right[end[1]] = 3.0 * w[0] * s[0]
        else:
            both = w[0] + w[1]
            bands[end], bands[beside] = w[1], both
            right[end[1]] = ((w[0] + 2.0 * both) * w[1] * s[0] + w[0] ** 2 * s[1]) / both
    return solve_tridiagonal(bands, right)


def _lagrange(times: _Floats, rows: _Floats, at: _Floats) -> _Floats:
    """Return the polynomial through two or three samples [shape=(times, columns)]."""
    result = np.zeros((len(at), rows.shape[1]))
    for one, row in enumerate(rows):
        others = np.delete(times, one)
        weight = np.prod((at[:, None] - others) / (times[one] - others), axis=1)
        result += weight[:, None] * row
    return result

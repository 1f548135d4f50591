"""Keep predictions from shaking more than what is measured.

A prediction shakes with the noise of the markers that it is made from, and jumps where its members
change. What is faster than a body moves is taken out by a low-pass, as far as it is more than the
marker's own measured path has of it. A prediction that shakes no more stays as it is.

The low-pass is the x that minimises ``|x - p|² + λ |D³ x|²`` with third differences D³
(Whittaker 1923): without delay, and with natural ends.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import runs

__all__ = ["jitter_power", "low_pass", "smooth_jitter"]

BODY_HZ = 10.0
"""Hz. Bodies move little above it."""

CUTS = (20.0, 16.0, 13.0, 10.0, 8.0, 6.5, 5.0)
"""Hz. Low-passes, the mildest first: the first one that is enough is taken. Fixed ones of 7 Hz and
less cost accuracy (2 % and more), chosen ones do not."""

HIGHEST = 0.4
"""Low-passes above this part of the rate do nothing."""

SHARE = 0.8
"""A prediction may shake with so much of the mean power that is measured: the seam adds some."""

MOVED = 0.5
"""A low-pass that moves a prediction by more than this part of its expected error (rms) is too
strong: what is known so well shakes because the body does."""

ORDER = 3
"""Order of the differences: the response is 1 / (1 + (f / cut)^6), sharp enough to keep steps."""

FEWEST = 12
"""Frames that a path needs to be judged or smoothed."""


def low_pass(path: NDArray[np.float64], rate: float, cut: float) -> NDArray[np.float64]:
    """Return a path without what is faster than a frequency.

    Parameters
    ----------
    path : ndarray [shape=(frames, ...), mm]
        More frames than `ORDER`, none NaN.
    rate : float
        Hz.
    cut : float
        Hz; a sine of this frequency is halved. Below half the rate.
    """
    from scipy.linalg import solveh_banded

    frames = len(path)
    gain = 2.0 * np.sin(np.pi * cut / rate)  # of a difference at ``cut``
    stiffness = gain ** (-2.0 * ORDER)
    difference = np.ones(1)
    for _ in range(ORDER):
        difference = np.convolve(difference, [1.0, -1.0])
    bands = np.zeros((ORDER + 1, frames))  # of I + λ D'D, upper form
    bands[ORDER] = 1.0
    for offset in range(ORDER + 1):
        for i in range(ORDER + 1 - offset):
            columns = slice(i + offset, i + offset + frames - ORDER)
            bands[ORDER - offset, columns] += stiffness * difference[i] * difference[i + offset]
    smooth: NDArray[np.float64] = solveh_banded(bands, path.reshape(frames, -1))
    return smooth.reshape(path.shape)


def jitter_power(path: NDArray[np.float64], rate: float) -> float:
    """Return the mean square acceleration of what is faster than a body moves.

    Parameters
    ----------
    path : ndarray [shape=(frames, 3), mm]
        Of one marker; NaN where missing.
    rate : float
        Hz.

    Returns
    -------
    float
        mm² per frame⁴. NaN where no run of samples is long enough, or the rate too low, to tell.
    """
    if rate * HIGHEST <= BODY_HZ:
        return float("nan")
    total, count = 0.0, 0
    for start, stop in runs(~np.isnan(path[:, 0])):
        if stop - start < FEWEST:
            continue
        fast = path[start:stop] - low_pass(path[start:stop], rate, BODY_HZ)
        bend = fast[2:] - 2.0 * fast[1:-1] + fast[:-2]
        total += float((bend**2).sum())
        count += len(bend)
    return total / count if count else float("nan")


def smooth_jitter(
    predicted: NDArray[np.float64],
    expected_rms: NDArray[np.float64],
    usual: NDArray[np.float64],
    rate: float,
) -> NDArray[np.float64]:
    """Smooth what shakes more than usual.

    Parameters
    ----------
    predicted : ndarray [shape=(frames, markers, 3), mm]
        None NaN.
    deviation : ndarray [shape=(frames, markers), mm]
        Expected rms Euclidean error.
    usual : ndarray [shape=(markers,), mm² per frame⁴]
        `jitter_power` of each marker's measured path. NaN: it is not smoothed.
    rate : float
        Hz.

    Returns
    -------
    ndarray [shape=(frames, markers, 3), mm]
        Of the markers that shake no more than `SHARE` of that exactly what was given.
    """
    if len(predicted) < FEWEST:
        return predicted
    calmed = predicted.copy()
    cuts = [cut for cut in CUTS if cut < HIGHEST * rate]
    for marker in np.flatnonzero(np.isfinite(usual)):
        bearable = SHARE * usual[marker]
        known = float((expected_rms[:, marker] ** 2).mean())
        for cut in cuts:
            if jitter_power(calmed[:, marker], rate) <= bearable:
                break
            smooth = low_pass(predicted[:, marker], rate, cut)
            if ((smooth - predicted[:, marker]) ** 2).sum(axis=1).mean() > MOVED**2 * known:
                break
            calmed[:, marker] = smooth
    return calmed

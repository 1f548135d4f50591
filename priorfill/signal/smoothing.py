"""Smooth predictions that have more jitter than the measured trajectory of the same marker.

A prediction inherits the noise of the markers it is computed from, and jumps where the models of
its ensemble change. Frequencies above those of body motion are low-passed until their power is no
higher than in the marker's measured trajectory. A prediction with no more jitter than that is left
unchanged.

The low-pass is the x that minimises ``|x - p|² + λ |D³ x|²`` with third differences D³, the
graduation of [W23]_. It has no delay, and natural boundary conditions.

References
----------
.. [W23] Whittaker, On a new method of graduation, Proceedings of the Edinburgh Mathematical
   Society 41, 1923.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import OptionError
from priorfill.gaps import runs
from priorfill.runtime.elementary import power, sin
from priorfill.runtime.lapack import solve_positive_banded
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = ["SmoothingOptions", "jitter_power", "low_pass", "smooth_jitter"]

DIFFERENCE_ORDER = 3
"""Order of the differences. The response is 1 / (1 + (f / cutoff)^6), steep enough to preserve
steps."""

MAX_RATE_RATIO = 200.0
"""Greatest ratio of frame rate and cut-off that the differences resolve: λ grows with the sixth
power, and rounding errors with it."""

MAX_KEPT_FRAMES = 256
"""Frames of the longest path whose matrix is kept; 512 of these take 4 MB."""


@dataclass(frozen=True)
class SmoothingOptions:
    """What counts as jitter, and how much smoothing is allowed.

    Attributes
    ----------
    body_frequency : float
        Hz. Bodies hardly move faster: power above it is jitter.
    cutoffs : tuple of float
        Hz, descending. The highest one that removes enough jitter is used. Low-passing every
        prediction at 7 Hz or less costs 2 % of accuracy and more; cut-offs chosen by the jitter
        cost none.
    max_cutoff_per_rate : float
        Low-passes above this fraction of the frame rate have no effect and are skipped.
    max_jitter_ratio : float
        Jitter power that a prediction may have, relative to the measured trajectory. Below 1,
        because the seams with measured samples add some.
    max_shift : float
        A low-pass is too strong if it moves a prediction by more than this multiple of its
        expected error (both rms): fast changes of an accurate prediction are motion of the body.
    min_frames : int
        Frames that a trajectory needs to be assessed or smoothed.
    """

    body_frequency: float = 10.0
    cutoffs: tuple[float, ...] = (20.0, 16.0, 13.0, 10.0, 8.0, 6.5, 5.0)
    max_cutoff_per_rate: float = 0.4
    max_jitter_ratio: float = 0.8
    max_shift: float = 0.5
    min_frames: int = 12

    def __post_init__(self) -> None:
        check_at_least(self, 1e-3, "body_frequency")
        check_between(self, 0.0, 0.49, "max_cutoff_per_rate")
        check_at_least(self, 0.0, "max_jitter_ratio", "max_shift")
        check_at_least(self, DIFFERENCE_ORDER + 1, "min_frames")
        if any(not cutoff > 0 for cutoff in self.cutoffs):
            raise OptionError(f"SmoothingOptions.cutoffs are {self.cutoffs}; give positive numbers")


def low_pass(path: NDArray[np.float64], rate: float, cutoff: float) -> NDArray[np.float64]:
    """Return a trajectory without its high frequencies.

    Parameters
    ----------
    path : ndarray [shape=(frames, ...), mm]
        More frames than `DIFFERENCE_ORDER`, none NaN.
    rate : float
        Hz.
    cutoff : float
        Hz; a sine of this frequency is halved. Below half the rate.

    Returns
    -------
    ndarray [shape as given, mm]

    Examples
    --------
    >>> line = np.linspace(0.0, 9.0, 10)[:, None]
    >>> bool(np.allclose(low_pass(line, 100.0, 10.0), line))
    True
    """
    if rate / cutoff > MAX_RATE_RATIO:
        return _low_pass_blocks(path, rate, cutoff)
    frames = len(path)
    bands = (_short_bands if frames <= MAX_KEPT_FRAMES else _bands)(frames, rate, cutoff)
    smooth = solve_positive_banded(bands, path.reshape(frames, -1))
    return smooth.reshape(path.shape)


def _bands(frames: int, rate: float, cutoff: float) -> NDArray[np.float64]:
    """Return the matrix I + λ D'D of a low-pass in upper banded form."""
    order = DIFFERENCE_ORDER
    gain = 2.0 * float(sin(np.pi * cutoff / rate))  # of one difference, at the cut-off
    penalty = float(power(gain, -2.0 * order))  # λ
    difference = np.ones(1)
    for _ in range(order):
        difference = np.convolve(difference, [1.0, -1.0])
    bands = np.zeros((order + 1, frames))
    bands[order] = 1.0
    for offset in range(order + 1):
        for i in range(order + 1 - offset):
            columns = slice(i + offset, i + offset + frames - order)
            bands[order - offset, columns] += penalty * difference[i] * difference[i + offset]
    return bands


_short_bands = lru_cache(maxsize=512)(_bands)
"""`_bands` of short paths, which are kept: a trial can have hundreds of short predictions."""


def _orthonormal(columns: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return an orthonormal basis of a few columns that are nearly orthogonal (Gram-Schmidt)."""
    basis = np.empty(columns.shape)
    for i in range(columns.shape[1]):
        left = columns[:, i].copy()
        for j in range(i):
            left -= (left * basis[:, j]).sum() * basis[:, j]
        basis[:, i] = left / np.sqrt((left**2).sum())
    return basis


def _low_pass_blocks(path: NDArray[np.float64], rate: float, cutoff: float) -> NDArray[np.float64]:
    """Return a trajectory without frequencies far below its rate, by the means of blocks.

    A parabola, to which the low-pass tends for λ towards infinity, is fitted first. The means of
    blocks of frames of the rest are low-passed, and a spline through them gives the frames.
    """
    from priorfill.signal.cubic_spline import cubic_spline  # imports SciPy, which is slow

    frames = len(path)
    flat = path.reshape(frames, -1)
    unit = np.linspace(-1.0, 1.0, frames)
    basis = _orthonormal(np.polynomial.legendre.legvander(unit, DIFFERENCE_ORDER - 1))
    smooth = basis @ (basis.T @ flat)
    block = int(np.ceil(rate / cutoff / MAX_RATE_RATIO))
    first = np.arange(0, frames - block + 1, block)
    if len(first) > DIFFERENCE_ORDER:
        used = len(first) * block  # the rest, shorter than a block, is extrapolated
        means = (flat - smooth)[:used].reshape(len(first), block, -1).mean(axis=1)
        nodes = low_pass(means, rate / block, cutoff)
        middle = first + 0.5 * (block - 1)
        smooth += cubic_spline(middle, nodes, np.arange(frames), natural=True)
    return smooth.reshape(path.shape)


def jitter_power(
    path: NDArray[np.float64], rate: float, options: SmoothingOptions = SmoothingOptions()
) -> float:
    """Return the mean squared second difference of what is faster than body motion.

    Parameters
    ----------
    path : ndarray [shape=(frames, 3), mm]
        Trajectory of one marker; NaN where missing.
    rate : float
        Hz.
    options : SmoothingOptions

    Returns
    -------
    float
        mm² per frame⁴. NaN where no run of samples is long enough, or the rate is too low to
        contain frequencies above those of body motion.

    See Also
    --------
    smooth_jitter : Smooths predictions with more jitter than is measured.
    """
    if rate * options.max_cutoff_per_rate <= options.body_frequency:
        return float("nan")
    total, count = 0.0, 0
    for start, stop in runs(~np.isnan(path[:, 0])):
        if stop - start < options.min_frames:
            continue
        fast = path[start:stop] - low_pass(path[start:stop], rate, options.body_frequency)
        second_difference = fast[2:] - 2.0 * fast[1:-1] + fast[:-2]
        total += float((second_difference**2).sum())
        count += len(second_difference)
    return total / count if count else float("nan")


def smooth_jitter(
    predicted: NDArray[np.float64],
    expected_rms: NDArray[np.float64],
    measured_power: NDArray[np.float64],
    rate: float,
    options: SmoothingOptions = SmoothingOptions(),
) -> NDArray[np.float64]:
    """Smooth predictions with more jitter than is measured.

    Parameters
    ----------
    predicted : ndarray [shape=(frames, markers, 3), mm]
        None NaN.
    expected_rms : ndarray [shape=(frames, markers), mm]
        Expected rms Euclidean error of the predictions.
    measured_power : ndarray [shape=(markers,), mm² per frame⁴]
        `jitter_power` of each marker's measured trajectory. NaN: the marker is not smoothed.
    rate : float
        Hz.
    options : SmoothingOptions

    Returns
    -------
    ndarray [shape=(frames, markers, 3), mm]
        Markers with little enough jitter are returned bit by bit as given.

    See Also
    --------
    jitter_power : The jitter of one trajectory.
    """
    if len(predicted) < options.min_frames:
        return predicted
    smoothed = predicted.copy()
    cutoffs = [cutoff for cutoff in options.cutoffs if cutoff < options.max_cutoff_per_rate * rate]
    for marker in np.flatnonzero(np.isfinite(measured_power)):
        allowed_power = options.max_jitter_ratio * measured_power[marker]
        max_shift = options.max_shift**2 * float((expected_rms[:, marker] ** 2).mean())  # mm²
        for cutoff in cutoffs:
            if jitter_power(smoothed[:, marker], rate, options) <= allowed_power:
                break
            candidate = low_pass(predicted[:, marker], rate, cutoff)
            if ((candidate - predicted[:, marker]) ** 2).sum(axis=1).mean() > max_shift:
                break
            smoothed[:, marker] = candidate
    return smoothed

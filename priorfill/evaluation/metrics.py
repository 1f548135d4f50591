"""Errors of filled samples, one by one and summarised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap
from priorfill.gp.calibration import MEAN_FACTOR

__all__ = [
    "MEASURES",
    "ErrorSummary",
    "SampleErrors",
    "distances",
    "measure",
    "summarise",
]

Array = NDArray[np.float64]

SampleErrors = NDArray[np.float32]
"""Measures of samples [shape=(len(MEASURES), samples)]; NaN where unknown."""

MEASURES = (
    "error",
    "absolute",
    "velocity",
    "acceleration",
    "expected_mean_error_mm",
    "error_bound_90_mm",
)
"""Rows of `SampleErrors`: distance from the truth (mm), mean over the coordinates of the absolute
error (mm), error of the velocity (mm/s) and of the acceleration (m/s²), expected distance from the
truth (mm), and distance below which 90 % of the errors are expected to lie (mm)."""

ERROR, ABSOLUTE, VELOCITY, ACCELERATION, EXPECTED_MEAN_ERROR, ERROR_BOUND_90 = range(len(MEASURES))

HIGH_PERCENTILE = 95.0
"""Percentile that describes the worse fills."""

MM_PER_M = 1000.0


@dataclass(frozen=True)
class ErrorSummary:
    """Errors of some samples that a method filled; NaN where unknown.

    Attributes
    ----------
    samples, filled : int
        Number of samples removed, and of those that were filled. All errors are over filled
        samples.
    mean, rmse, median, p95, maximum : float
        Of the Euclidean distance from the truth (mm).
    mae : float
        Mean absolute error over the coordinates (mm).
    velocity : float
        Mean error of the velocity (mm/s).
    acceleration : float
        Mean error of the acceleration (m/s²).
    expected_mean_error_mm : float
        Mean distance from the truth that the method expects (mm), over the samples with an
        expected error.
    error_bound_90_coverage : float
        Share of the samples with an error below their 90 % bound, over the samples with a bound.

    See Also
    --------
    priorfill.evaluate : Where summaries come from.
    """

    samples: int
    filled: int
    mean: float
    rmse: float
    median: float
    p95: float
    maximum: float
    mae: float
    velocity: float
    acceleration: float
    expected_mean_error_mm: float
    error_bound_90_coverage: float

    @property
    def share(self) -> float:
        """Share of the samples that were filled."""
        return self.filled / self.samples if self.samples else float("nan")


def distances(positions: Array, truth: Array) -> Array:
    """Return the distance of each sample from the truth [shape=(frames, markers), mm]."""
    found: Array = np.linalg.norm(positions - truth, axis=2)
    return found


def measure(
    truth: Array,
    filled: Array,
    expected_rms: Array,
    error_bound_90: Array,
    gaps: Sequence[Gap],
    rate: float,
) -> SampleErrors:
    """Compare the samples of some gaps with the truth.

    Velocities are central differences, (x[t+1] - x[t-1]) / 2 divided by the frame step;
    accelerations are second differences, x[t+1] - 2 x[t] + x[t-1] divided by its square. Both are
    unknown where one of the samples is. The error of a vector is the length of the difference from
    the true one.

    Parameters
    ----------
    truth, filled : ndarray [shape=(frames, markers, 3), mm]
        The true and the filled clip.
    expected_rms, error_bound_90 : ndarray [shape=(frames, markers), mm]
        The errors that the method expects: root mean square, and 90 % bound.
    gaps : sequence of Gap
        The gaps that were made.
    rate : float
        Hz.

    Returns
    -------
    ndarray [shape=(6, samples)]
        `MEASURES`, gap by gap; NaN where a sample was not filled.

    Examples
    --------
    >>> truth = np.zeros((3, 1, 3))
    >>> filled = truth.copy()
    >>> filled[1, 0] = [3.0, 4.0, 0.0]
    >>> unknown = np.full((3, 1), np.nan)
    >>> float(measure(truth, filled, unknown, unknown, [Gap(1, 2, 0)], 100.0)[ERROR, 0])
    5.0
    """
    off = filled - truth
    velocity, acceleration = np.full_like(off, np.nan), np.full_like(off, np.nan)
    velocity[1:-1] = (off[2:] - off[:-2]) * (rate / 2)
    acceleration[1:-1] = (off[2:] - 2 * off[1:-1] + off[:-2]) * (rate**2 / MM_PER_M)
    by_measure = (
        np.linalg.norm(off, axis=2),
        np.abs(off).mean(axis=2),
        # the central difference exists where the sample itself was not filled, but does not count
        np.linalg.norm(np.where(np.isnan(off), np.nan, velocity), axis=2),
        np.linalg.norm(acceleration, axis=2),
        MEAN_FACTOR * expected_rms,
        error_bound_90,
    )
    where = [(slice(gap.start, gap.stop), gap.marker) for gap in gaps]
    return np.array(
        [np.concatenate([values[at] for at in where]) for values in by_measure], dtype=np.float32
    )


def summarise(samples: SampleErrors) -> ErrorSummary:
    """Return the summary of some samples [shape=(6, samples)]."""
    unknown = float("nan")
    filled = np.isfinite(samples[ERROR])
    some = samples[:, filled].astype(np.float64)
    if not some.shape[1]:
        return ErrorSummary(samples.shape[1], 0, *[unknown] * 10)
    error = some[ERROR]
    bounded = np.isfinite(some[ERROR_BOUND_90])
    within = (error < some[ERROR_BOUND_90])[bounded]
    return ErrorSummary(
        samples=samples.shape[1],
        filled=some.shape[1],
        mean=float(error.mean()),
        rmse=float(np.sqrt((error**2).mean())),
        median=float(np.median(error)),
        p95=float(np.percentile(error, HIGH_PERCENTILE)),
        maximum=float(error.max()),
        mae=float(some[ABSOLUTE].mean()),
        velocity=mean_known(some[VELOCITY]),
        acceleration=mean_known(some[ACCELERATION]),
        expected_mean_error_mm=mean_known(some[EXPECTED_MEAN_ERROR]),
        error_bound_90_coverage=float(within.mean()) if bounded.any() else unknown,
    )


def mean_known(values: Array) -> float:
    """Return the mean of the finite values; NaN where there is none."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")

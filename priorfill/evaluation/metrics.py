"""How far off a fill is, sample by sample, and what many samples say together."""

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
"""Measures of samples [shape=(len(MEASURES), samples)]; NaN where there is none."""

MEASURES = ("error", "absolute", "velocity", "acceleration", "expected", "bound")
"""Rows of `SampleErrors`: distance from the truth (mm), mean over the coordinates of the absolute
error (mm), error of the velocity (mm/s), of the acceleration (m/s²), distance expected by the
method (mm), distance below which it expects 90 % of the errors (mm)."""

ERROR, ABSOLUTE, VELOCITY, ACCELERATION, EXPECTED, BOUND = range(len(MEASURES))

HIGH = 95.0
"""Percentile that says how bad the worse fills are."""

MM_PER_M = 1000.0


@dataclass(frozen=True)
class ErrorSummary:
    """What some samples, filled by one method, say together; NaN where nothing is known.

    Attributes
    ----------
    samples, filled : int
        Samples removed, and how many of them were filled. All errors are over the filled ones.
    mean, rmse, median, p95, maximum : float
        Of the distance from the truth (mm).
    mae : float
        Mean absolute error over the coordinates (mm).
    velocity : float
        Mean error of the velocity (mm/s).
    acceleration : float
        Mean error of the acceleration (m/s²).
    expected : float
        Mean distance that the method expects (mm), of the samples that it says it of.
    cover : float
        Share of the samples that are nearer to the truth than their 90 % bound, of those that have
        one.
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
    expected: float
    cover: float

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
    bound: Array,
    gaps: Sequence[Gap],
    rate: float,
) -> SampleErrors:
    """Compare the samples of some gaps with the truth.

    Velocities are central differences, (x[t+1] - x[t-1]) / 2 by the frame step, accelerations
    second differences, x[t+1] - 2 x[t] + x[t-1] by its square; both are unknown where one of the
    samples is. The error of a vector is the length of the difference from the true one.

    Parameters
    ----------
    truth, filled : ndarray [shape=(frames, markers, 3), mm]
        The true and the filled clip.
    deviation, bound : ndarray [shape=(frames, markers), mm]
        What the method expects of its errors: root mean square, 90 % bound.
    gaps : sequence of Gap
        What was removed.
    rate : float
        Hz.

    Returns
    -------
    ndarray [shape=(6, samples)]
        `MEASURES`, gap by gap; NaN where a sample was not filled.
    """
    off = filled - truth
    speed, bend = np.full_like(off, np.nan), np.full_like(off, np.nan)
    speed[1:-1] = (off[2:] - off[:-2]) * (rate / 2)
    bend[1:-1] = (off[2:] - 2 * off[1:-1] + off[:-2]) * (rate**2 / MM_PER_M)
    by_measure = (
        np.linalg.norm(off, axis=2),
        np.abs(off).mean(axis=2),
        # the velocity of a sample that was not filled is no error of the method
        np.linalg.norm(np.where(np.isnan(off), np.nan, speed), axis=2),
        np.linalg.norm(bend, axis=2),
        MEAN_FACTOR * expected_rms,
        bound,
    )
    where = [(slice(gap.start, gap.stop), gap.marker) for gap in gaps]
    return np.array(
        [np.concatenate([values[at] for at in where]) for values in by_measure], dtype=np.float32
    )


def summarise(samples: SampleErrors) -> ErrorSummary:
    """Return what some samples [shape=(6, samples)] say together."""
    nothing = float("nan")
    there = np.isfinite(samples[ERROR])
    some = samples[:, there].astype(np.float64)
    if not some.shape[1]:
        return ErrorSummary(samples.shape[1], 0, *[nothing] * 10)
    error = some[ERROR]
    bounded = np.isfinite(some[BOUND])
    return ErrorSummary(
        samples=samples.shape[1],
        filled=some.shape[1],
        mean=float(error.mean()),
        rmse=float(np.sqrt((error**2).mean())),
        median=float(np.median(error)),
        p95=float(np.percentile(error, HIGH)),
        maximum=float(error.max()),
        mae=float(some[ABSOLUTE].mean()),
        velocity=mean_known(some[VELOCITY]),
        acceleration=mean_known(some[ACCELERATION]),
        expected=mean_known(some[EXPECTED]),
        cover=float((error < some[BOUND])[bounded].mean()) if bounded.any() else nothing,
    )


def mean_known(values: Array) -> float:
    """Return the mean of the values that are known; NaN where there is none."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")

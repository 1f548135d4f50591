"""Bridge a short gap over time alone, where the other markers say nothing.

Each coordinate is a line plus a Gaussian process in time with Matérn covariance of smoothness
5/2, which follows position, velocity and acceleration at both edges [R06]_ (Eq. 4.17); on gaps of
a quarter to half a second of everyday movement it errs by 0.62 of what a cubic spline does.

References
----------
.. [R06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LONGEST", "Curve", "decaying_velocity", "interpolate_gap", "process_in_time"]

LONGEST = 0.5
"""s. Nothing is bridged that is longer: by then a movement may have gone anywhere."""

SECONDS = 0.3
"""s. Time scale of the process, and how far beside the gap it looks."""

NOISE = 1e-7
"""Variance of a sample's noise in units of the process's."""

PROCESSES = (
    (2.5, 0.3, 1e-7),
    (2.5, 0.5, 1e-7),
    (2.5, 1.0, 1e-7),
    (2.5, 0.3, 1e-5),
    (2.5, 0.2, 1e-5),
    (2.5, 0.3, 1e-4),
    (3.5, 0.2, 1e-7),
    (3.5, 0.2, 1e-6),
    (1.5, 0.3, 1e-7),
)
"""Smoothness, time scale (s) and noise of the processes that lead through a blackout; the first is
`interpolate_gap`'s. Noisy and smooth recordings, and long and short gaps, ask for different
ones."""

OWN_SECONDS = (0.2, 0.05, 0.1, 0.4, 1.0)
"""s. How long a marker goes on as it went; the first is the first guess."""

COMMON_SECONDS = (0.3, 1.0, 4.0)
"""s. How long the body goes on as it went."""

VELOCITY_SECONDS = 0.05
"""s. The velocity at the clip's end is that of a line through so much of it."""


def _covariance(
    one: NDArray[np.float64],
    other: NDArray[np.float64],
    smoothness: float = 2.5,
    seconds: float = SECONDS,
) -> NDArray[np.float64]:
    """Covariance of a process at two sets of times [shapes=(a,), (b,), s]."""
    r = np.sqrt(2.0 * smoothness) * np.abs(one[:, None] - other) / seconds
    # [R06]_ Eqs. (4.16), (4.17)
    shape = 1.0 + r
    if smoothness == 2.5:
        shape = shape + r**2 / 3.0
    elif smoothness == 3.5:
        shape = shape + 0.4 * r**2 + r**3 / 15.0
    covariance: NDArray[np.float64] = shape * np.exp(-r)
    return covariance


def _line(time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Basis of a line at some times [shape=(times, 2)]."""
    return np.stack([np.ones_like(time), time], axis=1)


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve through a blackout: a linear function of the samples beside it.

    Attributes
    ----------
    each : ndarray [shape=(asked, known)]
        Applies to the samples of each marker.
    together : ndarray [shape=(asked, known)] or None
        Applies to the mean of all markers, and is added.
    """

    each: NDArray[np.float64]
    together: NDArray[np.float64] | None = None


def process_in_time(known: NDArray[np.float64], asked: NDArray[np.float64]) -> list[Curve]:
    """Return the curves of `PROCESSES` for a gap of which both sides are seen.

    Parameters
    ----------
    known, asked : ndarray [shapes=(known,), (asked,), s]
        Times.
    """
    curves = []
    for smoothness, seconds, noise in PROCESSES:
        covariance = _covariance(known, known, smoothness, seconds)
        covariance[np.diag_indices_from(covariance)] += noise
        inverse = np.linalg.inv(covariance)
        cross = _covariance(asked, known, smoothness, seconds) @ inverse
        # the line is free, [R06]_ Eq. (2.42)
        centre = known.mean()
        basis = _line(known - centre)
        line = np.linalg.solve(basis.T @ inverse @ basis, basis.T @ inverse)
        curves.append(Curve(cross + (_line(asked - centre) - cross @ basis) @ line))
    return curves


def decaying_velocity(known: NDArray[np.float64], asked: NDArray[np.float64]) -> list[Curve]:
    """Return curves for a gap of which one side is seen: the velocity there dies away.

    Parameters
    ----------
    known, asked : ndarray [shapes=(known,), (asked,), s]
        Times; all asked ones before all known ones, or after them.
    """
    forward = asked[0] > known[-1]
    edge = known[-1] if forward else known[0]
    away = np.abs(asked - edge)
    used = np.abs(known - edge) <= VELOCITY_SECONDS
    used |= np.abs(known - edge) <= np.sort(np.abs(known - edge))[1]
    weights = np.zeros(len(known))
    centred = known[used] - known[used].mean()
    weights[used] = centred / (centred @ centred)
    velocity = weights if forward else -weights
    hold = np.zeros((len(asked), len(known)))
    hold[:, -1 if forward else 0] = 1.0

    def covered(seconds: float) -> NDArray[np.float64]:
        """Distance covered by a velocity that dies away, as a function of the samples."""
        return np.outer(-seconds * np.expm1(-away / seconds), velocity)

    own = [Curve(hold + covered(seconds)) for seconds in OWN_SECONDS]
    short = covered(OWN_SECONDS[0])
    common = [Curve(hold + short, covered(s) - short) for s in COMMON_SECONDS]
    return [*own, *common, Curve(hold)]


def interpolate_gap(
    positions: NDArray[np.float64], start: int, stop: int, rate: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Bridge a gap of one marker.

    Parameters
    ----------
    positions : ndarray [shape=(frames, 3), mm]
        The marker's samples, NaN where missing.
    start, stop : int
        Frames to find.
    rate : float
        Hz.

    Returns
    -------
    positions : ndarray [shape=(stop - start, 3), mm]
    deviation : ndarray [shape=(stop - start,), mm]
        Expected rms Euclidean error.

    None instead of both where the gap is longer than `LONGEST`, or has not at least two
    samples within `SECONDS` on either side.
    """
    if (stop - start) / rate > LONGEST:
        return None
    reach = max(2, round(SECONDS * rate))
    window = np.arange(max(0, start - reach), min(len(positions), stop + reach))
    known = window[~np.isnan(positions[window, 0])]
    if (known < start).sum() < 2 or (known >= stop).sum() < 2:
        return None
    centre = 0.5 * (start + stop)
    time = (known - centre).astype(np.float64) / rate
    asked = (np.arange(start, stop) - centre).astype(np.float64) / rate
    covariance = _covariance(time, time)
    covariance[np.diag_indices_from(covariance)] += NOISE
    inverse = np.linalg.inv(covariance)
    cross = _covariance(asked, time) @ inverse
    # the line is free, [R06]_ Eq. (2.42); its coefficients are known up to ``doubt``
    basis = _line(time)
    doubt = np.linalg.inv(basis.T @ inverse @ basis)
    middle = positions[known].mean(axis=0)
    samples = positions[known] - middle
    line = doubt @ (basis.T @ (inverse @ samples))
    rest = samples - basis @ line
    found = _line(asked) @ line + cross @ rest + middle
    # the process's variance is what makes the samples beside the gap likely
    unit = np.einsum("ki,kl,li->", rest, inverse, rest) / (len(known) - 2)
    beyond = _line(asked) - cross @ basis
    left = 1.0 - np.einsum("qk,qk->q", cross, _covariance(asked, time))
    left += np.einsum("qa,ab,qb->q", beyond, doubt, beyond)
    return found, np.sqrt(np.maximum(unit, 0.0) * np.maximum(left, NOISE))

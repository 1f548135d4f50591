"""Resampling with anti-aliasing, and the pyramid of levels.

All functions take positions (frames, markers, 3) in which NaN means missing, and keep the time
origin: frame 0 is at t = 0 at every rate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import OptionError
from priorfill.runtime.elementary import bessel_i0, sin
from priorfill.signal.running import symmetric_filter

__all__ = ["Level", "Resolution", "pyramid", "resample"]

CUTOFF = 0.75
"""Half-amplitude frequency of the anti-alias filter, as a fraction of the new Nyquist
frequency: the pass band ends at `CUTOFF` - `TRANSITION` / 2, the stop band begins at 1."""

TRANSITION = 0.5
"""Width of the filter's transition band, as a fraction of the new Nyquist frequency. Human movement
has little above 6 Hz, so a wide band costs nothing, and it keeps the filter short, so that fewer
measured samples have a gap within its support."""

ATTENUATION = 50.0
"""dB. Stop-band attenuation: 1 mm of vibration above the new Nyquist frequency leaves 3 µm."""

KAISER_BETA = 4.533514120981248
"""Shape of the window: 0.5842 (A - 21)^0.4 + 0.07886 (A - 21), for an attenuation A of 21 to 50."""

MAX_DENSE_TAPS = 2000
"""Taps up to which all samples are filtered, wanted or not: down to a 170th of the rate."""

FIRST_SEARCH = 64
"""Samples among which a measured one is searched first; then among twice as many, and so on."""

TIME_TOLERANCE = 1e-6
"""Frames. New and old samples closer in time than this coincide; more than the rounding error of
t = i * rate_from / rate_to in any clip that fits into memory."""


@dataclass(frozen=True, eq=False)
class Level:
    """One resolution of the pyramid.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Low-passed positions, NaN where missing.
    rate : float
        Frames per second (Hz).
    step : int
        Frames of level 0 per frame of this level, a power of two.
    """

    positions: NDArray[np.float64]
    rate: float
    step: int

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.positions)

    def window(self, first: int, last: int, markers: Sequence[int]) -> NDArray[np.float64]:
        """Return a copy of some markers in frames ``first <= frame < last``."""
        return self.positions[first:last, list(markers)]


@dataclass(frozen=True, eq=False)
class Resolution:
    """One level of a recording, computed only where it is needed.

    The samples are those of a `Level` bit by bit, without the memory for the complete level.

    Attributes
    ----------
    finest : ndarray [shape=(frames, markers, 3), mm]
        The recording; NaN where missing.
    finest_rate : float
        Hz. Its rate.
    step : int
        Frames of the recording per frame of this level.
    """

    finest: NDArray[np.float64]
    finest_rate: float
    step: int

    @property
    def rate(self) -> float:
        """Frames per second (Hz)."""
        return self.finest_rate / self.step

    @property
    def frames(self) -> int:
        """Number of frames."""
        return (len(self.finest) - 1) // self.step + 1

    def window(self, first: int, last: int, markers: Sequence[int]) -> NDArray[np.float64]:
        """Return a copy of some markers in frames ``first <= frame < last``."""
        inside = slice(first * self.step, (last - 1) * self.step + 1)
        if self.step == 1:
            return self.finest[inside, list(markers)]
        taps = _anti_alias(float(self.step))
        half = len(taps) // 2
        result = np.empty((last - first, len(markers), 3))
        for column, marker in enumerate(markers):
            start, stop, pad = _filter_range(self.finest[:, marker, 0], inside, half)
            path = self.finest[start:stop, marker : marker + 1]
            missing = np.isnan(path[..., 0])
            padded = _interpolate_gaps(path, missing, pad)
            wanted = np.arange(inside.start, inside.stop, self.step) - start
            result[:, column] = _filtered(padded, taps, wanted + pad)[:, 0]
            result[missing[wanted, 0], column] = np.nan
        return result


def _filter_range(
    coordinate: NDArray[np.float64], inside: slice, half: int
) -> tuple[int, int, int]:
    """Return the range of samples that filtered ones depend on, and the padding they need.

    Parameters
    ----------
    coordinate : ndarray [shape=(frames,)]
        Of a marker; NaN where missing.
    inside : slice
        The filtered samples.
    half : int
        Half-width of the filter.
    """
    frames = len(coordinate)
    first, last = inside.start - half, inside.stop - 1 + half
    # complete gaps, with the two samples on either side that determine the curve across them
    before = _distance_to_known(coordinate[first::-1]) if 0 <= first < frames else None
    after = _distance_to_known(coordinate[last:]) if 0 <= last < frames else None
    if before is None or after is None:
        return 0, frames, half  # beyond the ends, the complete path is reflected
    return max(first - before - 1, 0), min(last + after + 2, frames), 0


def _distance_to_known(values: NDArray[np.float64]) -> int | None:
    """Return the index of the first value that is not NaN; None where there is none."""
    start, size = 0, FIRST_SEARCH
    while start < len(values):
        known = ~np.isnan(values[start : start + size])
        if known.any():
            return start + int(known.argmax())
        start, size = start + size, 2 * size
    return None


def resample(
    positions: NDArray[np.floating], rate_from: float, rate_to: float
) -> NDArray[np.float64]:
    """Return positions at another frame rate.

    To a lower rate, a zero-phase low-pass (centred linear-phase FIR, Kaiser window) first removes
    frequencies above the new Nyquist frequency. The result is a cubic spline, evaluated at the new
    times. Slow signals pass nearly unchanged, constant and linear ones exactly. Missing samples are
    interpolated for the filter and the spline only.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    rate_from : float
        Hz. Rate of ``positions``.
    rate_to : float
        Hz. New rate.

    Returns
    -------
    ndarray [shape=(frames', markers, 3), mm]
        With frames' = floor((frames - 1) * rate_to / rate_from) + 1. A sample is missing if one of
        the old samples around its time is.

    Raises
    ------
    OptionError
        If a rate is not a positive number, or ``positions`` is not (frames, markers, 3).

    See Also
    --------
    pyramid : All levels.

    Examples
    --------
    >>> line = np.linspace(0.0, 12.0, 13)[:, None, None] * np.ones(3)
    >>> np.round(resample(line, 120.0, 30.0)[:, 0, 0], 6) + 0.0
    array([ 0.,  4.,  8., 12.])
    """
    data = _validated(positions)
    for rate in (rate_from, rate_to):
        _check_rate(rate)
    frames, markers, _ = data.shape
    if frames == 0 or rate_from == rate_to:
        return data.copy()
    missing: NDArray[np.bool_] = np.isnan(data.sum(axis=2))
    ratio = rate_from / rate_to
    count = math.floor((frames - 1) / ratio + TIME_TOLERANCE) + 1
    times = np.arange(count) * ratio
    nearest = np.minimum(np.rint(times).astype(np.intp), frames - 1)
    coincides = np.abs(times - nearest) < TIME_TOLERANCE
    before = np.where(coincides, nearest, np.floor(times).astype(np.intp))
    after = np.where(coincides, nearest, np.minimum(before + 1, frames - 1))
    if ratio > 1:
        taps = _anti_alias(ratio)
        half = len(taps) // 2
        padded = _interpolate_gaps(data, missing, half)
        # the spline needs all samples
        wanted = nearest if coincides.all() else np.arange(frames)
        smooth = _filtered(padded, taps, half + wanted)
    else:
        smooth = _interpolate_gaps(data, missing, 0)
    if coincides.all():
        result = smooth if ratio > 1 else smooth[nearest]
    else:
        from scipy.interpolate import CubicSpline  # slow to import; not needed for integer ratios

        flat = smooth.reshape(frames, markers * 3)
        result = CubicSpline(np.arange(frames), flat)(times).reshape(count, markers, 3)
        # the spline interpolates its nodes; take these without rounding errors
        result[coincides] = smooth[nearest[coincides]]
    result[missing[before] | missing[after]] = np.nan
    return np.ascontiguousarray(result)


def pyramid(positions: NDArray[np.floating], rate: float, levels: int) -> list[Level]:
    """Return the levels r_i = rate / 2^i, finest first: Eq. (5) of Baumann et al. 2011.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    rate : float
        Hz. Rate of ``positions``.
    levels : int
        Number of levels.

    Returns
    -------
    list of Level
        Level 0 has the positions as given, level i every 2^i-th frame of the low-passed positions.
        Frame j of level i is at the time of frame j * 2^i of level 0.

    Raises
    ------
    OptionError
        If ``levels`` is below 1, or for the reasons given for `resample`.

    See Also
    --------
    resample : Computes one level.
    Resolution : A level that is computed only where it is needed.
    """
    if levels < 1:
        raise OptionError(f"a pyramid cannot have {levels} levels; give 1 or more")
    result = []
    for i in range(levels):
        step = 2**i
        result.append(Level(resample(positions, rate, rate / step), rate / step, step))
    return result


def _validated(positions: NDArray[np.floating]) -> NDArray[np.float64]:
    data = np.asarray(positions, dtype=np.float64)
    if data.ndim != 3 or data.shape[2] != 3:
        raise OptionError(f"positions have shape {data.shape}; give them as (frames, markers, 3)")
    return data


def _check_rate(rate: float) -> None:
    if not (math.isfinite(rate) and rate > 0):
        raise OptionError(f"the frame rate is {rate:g} Hz; give a positive number")


@lru_cache(maxsize=32)  # a database resamples all its clips by the same few ratios
def _anti_alias(ratio: float) -> NDArray[np.float64]:
    """Return the taps, odd in number and summing to 1, for a rate divided by ``ratio`` > 1."""
    # Kaiser's rules for length and shape of the window (Oppenheim and Schafer, Discrete-Time
    # Signal Processing, section 7.5.3); scipy.signal has them too, but is slow to import
    length = math.ceil((ATTENUATION - 7.95) / (2.285 * math.pi * TRANSITION / ratio)) + 1
    half = (length | 1) // 2
    offset = np.arange(1, half + 1)
    phase = math.pi * CUTOFF / ratio * offset
    window = bessel_i0(KAISER_BETA * np.sqrt(1.0 - (offset / half) ** 2)) / bessel_i0(KAISER_BETA)
    side = sin(phase) / phase * window
    taps = np.concatenate([side[::-1], [1.0], side])
    return np.asarray(taps / taps.sum(), dtype=np.float64)


def _filtered(
    padded: NDArray[np.float64], taps: NDArray[np.float64], wanted: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Return some filtered samples of ``padded`` (frames, markers, 3), in which all taps have one.

    At a small fraction of the rate each sample is a sum of its own. For the other samples, which
    are not wanted, the time would be quadratic in the ratio of the rates.
    """
    if len(taps) <= MAX_DENSE_TAPS:
        return symmetric_filter(padded, taps, wanted)
    half = len(taps) // 2
    result = np.empty((len(wanted), *padded.shape[1:]))
    for row, at in enumerate(wanted):
        result[row] = (taps[:, None, None] * padded[at - half : at + half + 1]).sum(axis=0)
    return result


def _interpolate_gaps(
    data: NDArray[np.float64], missing: NDArray[np.bool_], pad: int
) -> NDArray[np.float64]:
    """Return ``data`` with gaps interpolated, extended by ``pad`` frames at either end.

    Before the first and after the last valid sample follows the odd reflection of the measured
    samples, which preserves value and slope. A marker that is missing throughout becomes 0.
    """
    frames, markers, _ = data.shape
    result = np.zeros((frames + 2 * pad, markers, 3))
    complete = ~missing.any(axis=0)
    if complete.any():
        result[:, complete] = _reflect(data[:, complete], pad, pad)
    for marker in np.flatnonzero(~complete):
        valid = np.flatnonzero(~missing[:, marker])
        if valid.size == 0:
            continue
        first, last = valid[0], valid[-1]
        run = data[first : last + 1, marker].copy()
        _interpolate_inner_gaps(run, valid - first)
        result[:, marker] = _reflect(run, first + pad, frames - 1 - last + pad)
    return result


def _reflect(data: NDArray[np.float64], before: int, after: int) -> NDArray[np.float64]:
    widths = [(before, after)] + [(0, 0)] * (data.ndim - 1)
    return np.pad(data, widths, mode="reflect", reflect_type="odd")


def _interpolate_inner_gaps(run: NDArray[np.float64], valid: NDArray[np.intp]) -> None:
    """Fill the inner gaps of one marker's ``run`` (frames, 3) in place, by cubic Hermite splines.

    They continue the slope on either side. A straight line would have a kink at the edge of the
    gap, and the filter would spread it to measured samples.
    """
    inner = np.flatnonzero(np.diff(valid) > 1)  # the gaps, by the valid sample before them
    if not len(inner):
        return
    a, b = valid[inner], valid[inner + 1]
    length = (b - a)[:, None]
    chord = (run[b] - run[a]) / length
    steps = np.diff(valid) == 1
    runs_on = np.concatenate([[False], steps])[inner][:, None]  # the sample before `a` is valid
    slope_a = np.where(runs_on, run[a] - run[a - 1], chord)
    runs_on = np.concatenate([steps, [False]])[inner + 1][:, None]
    slope_b = np.where(runs_on, run[np.minimum(b + 1, len(run) - 1)] - run[b], chord)
    gap = np.repeat(np.arange(len(inner)), b - a - 1)
    frames = np.setdiff1d(np.arange(len(run)), valid, assume_unique=True)
    length, chord, slope_a, slope_b = length[gap], chord[gap], slope_a[gap], slope_b[gap]
    s = (frames - a[gap])[:, None] / length
    run[frames] = (
        run[a][gap]
        + chord * length * s**2 * (3 - 2 * s)
        + slope_a * length * s * (1 - s) ** 2
        - slope_b * length * s**2 * (1 - s)
    )

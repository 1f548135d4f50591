"""Estimates of short gaps over time, and their expected errors.

A gap is estimated from the few samples of its marker before and after it, by Gaussian processes of
time: of the marker's path in the world, and of its path in the frame of its nearest rigid
neighbours (`priorfill.methods.gpr.short_gaps.local_paths`), each with several noise variances.

Blocks as long as the gap are left out at other times of the same marker. The square error of a
process in a gap is estimated as

    c v sqrt(s)

with v its predicted variance in units of its own, s its scale, estimated from the samples around
the gap, and c such that it holds for the blocks that were left out. With s instead of sqrt(s) a gap
in a fast movement, and without it one in a slow movement, has a less accurate expected error: the
correlations of the logarithms of expected and actual errors were 0.83 to 0.98 with it in recordings
of walking, exercises and acrobatics.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap
from priorfill.geometry.poses import evenly_spaced
from priorfill.gp.calibration import calibrate
from priorfill.gp.linalg import power_weights
from priorfill.methods.gpr.short_gaps.local_paths import LocalPaths
from priorfill.methods.gpr.short_gaps.options import ShortGapOptions
from priorfill.signal.nearby_samples import NearbySamples, SampleWeights, rows_by_marker

__all__ = ["ShortGapEstimate", "estimate_short_gaps"]

LENGTH_RATIO = 1.4
"""Ratio of the lengths of blocks that are left out."""

MIN_ERROR = 1e-6
"""mm. Least expected error: that of a marker that does not move is 0."""

_Floats = NDArray[np.float64]
_Ints = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class ShortGapEstimate:
    """The estimate of one gap.

    Attributes
    ----------
    gap : Gap
        Its marker and frames.
    positions : ndarray [shape=(frames, 3), mm]
    expected_rms : ndarray [shape=(frames,), mm]
        Expected rms Euclidean error.
    bound_factor : float
        Factor of `expected_rms` that gives the bound below which 90 % of the errors are expected.
    """

    gap: Gap
    positions: _Floats
    expected_rms: _Floats
    bound_factor: float

    @property
    def rms(self) -> float:
        """Expected rms error over the gap (mm)."""
        return float(np.sqrt((self.expected_rms**2).mean()))


def estimate_short_gaps(
    positions: _Floats,
    gaps: Sequence[Gap],
    rate: float,
    geometry: tuple[_Floats, _Floats],
    options: ShortGapOptions,
) -> list[ShortGapEstimate]:
    """Estimate gaps over time.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        The clip; NaN where missing.
    gaps : sequence of Gap
        Some of its gaps.
    rate : float
        Hz.
    geometry : pair of ndarray [shape=(markers, markers), mm]
        Rms distance and spread of each pair of markers.
    options : ShortGapOptions
        The processes.

    Returns
    -------
    list of ShortGapEstimate
        Of the gaps with samples on both sides, in clips long enough that their error is known.

    See Also
    --------
    priorfill.signal.gp_interpolation.interpolate_gap : One gap, with a predicted error only.
    """
    known = {m: np.flatnonzero(~np.isnan(positions[:, m, 0])) for m in {g.marker for g in gaps}}
    context = max(options.samples_per_side, round(options.context_seconds * rate))
    by_length = _by_length(gaps)

    def near(markers: _Ints, starts: _Ints, length: int) -> NearbySamples:
        return NearbySamples.of(known, (markers, starts), length, options.samples_per_side, context)

    groups = {length: near(*some, length) for length, some in by_length.items()}
    blocks = {
        length: near(*_blocks(known, markers, length, len(positions), options.blocks), length)
        for length, markers in _markers_by_block_length(by_length).items()
    }
    keys = _keys([*groups.values(), *blocks.values()], len(positions))
    poses = _completed_poses(positions, keys, groups.values(), rate, options)
    local = LocalPaths.of(poses, keys, len(positions), geometry, options)
    clip = _Clip(positions, rate, local, options)
    errors = {
        (int(marker), length): error
        for length, some in blocks.items()
        for marker, error in _held_out_errors(clip, some)
    }
    return [
        estimate for length, some in groups.items() for estimate in _estimates(clip, some, errors)
    ]


def _by_length(gaps: Sequence[Gap]) -> dict[int, tuple[_Ints, _Ints]]:
    """Return markers and starts of the gaps of each length, those of a marker together."""
    found: dict[int, list[tuple[int, int]]] = {}
    for gap in gaps:
        found.setdefault(gap.frames, []).append((gap.marker, gap.start))
    sorted_gaps = {n: np.array(sorted(some), dtype=np.intp).T for n, some in sorted(found.items())}
    return {length: (some[0], some[1]) for length, some in sorted_gaps.items()}


def _block_length(length: int) -> int:
    """Return the length of the blocks that are left out for gaps of some length."""
    block = 1
    while block < length:
        block = max(block + 1, round(LENGTH_RATIO * block))
    return block


def _markers_by_block_length(by_length: Mapping[int, tuple[_Ints, _Ints]]) -> dict[int, _Ints]:
    """Return the markers that have gaps of each length of blocks."""
    found: dict[int, list[_Ints]] = {}
    for length, (markers, _) in by_length.items():
        found.setdefault(_block_length(length), []).append(markers)
    return {length: np.unique(np.concatenate(some)) for length, some in found.items()}


def _blocks(
    known: Mapping[int, _Ints], markers: _Ints, length: int, frames: int, count: int
) -> tuple[_Ints, _Ints]:
    """Return markers and starts of blocks, evenly spaced, whose middle sample is known."""
    chosen, starts = [np.empty(0, dtype=np.intp)], [np.empty(0, dtype=np.intp)]
    for marker in markers:
        own = known[int(marker)]
        first = own[evenly_spaced(len(own), count)] - length // 2
        first = np.unique(first[(first > 0) & (first + length < frames)])
        chosen.append(np.full(len(first), marker))
        starts.append(first)
    return np.concatenate(chosen), np.concatenate(starts)


def _completed_poses(
    positions: _Floats,
    keys: _Ints,
    groups: Iterable[NearbySamples],
    rate: float,
    options: ShortGapOptions,
) -> tuple[_Ints, _Floats]:
    """Return the poses that keys need, with gaps interpolated in the world.

    These alone, because a copy of a long clip is large.
    """
    numbers = np.unique(keys % len(positions))
    completed = positions[numbers]
    process = options.processes[len(options.processes) // 2 - 1]
    for some in groups:
        (weights,) = SampleWeights.of(some, (process,), rate)
        found, _ = weights.predict(positions[some.frames, some.markers[:, None]], some.used)
        completed[np.searchsorted(numbers, some.inside), some.markers[:, None]] = found
    return numbers, completed


def _keys(groups: Sequence[NearbySamples], frames: int) -> _Ints:
    """Return the samples in which local paths are needed; see `LocalPaths.keys`."""
    return np.unique(
        np.concatenate(
            [
                (some.markers[:, None] * frames + which).reshape(-1)
                for some in groups
                for which in (some.frames, some.inside)
            ]
        )
    )


@dataclass(frozen=True, eq=False)
class _Clip:
    """What all estimates use."""

    positions: _Floats
    rate: float
    local: LocalPaths
    options: ShortGapOptions


@dataclass(frozen=True, eq=False)
class _Candidates:
    """The estimates of each process, in the world and in local frames.

    Attributes
    ----------
    positions : ndarray [shape=(candidates, gaps, length, 3), mm]
        NaN where there is no local frame.
    variance : ndarray [shape=(candidates, gaps, length)]
        Up to a factor for each candidate; NaN where a local frame of the gap is missing.
    """

    positions: _Floats
    variance: _Floats

    @classmethod
    def of(cls, clip: _Clip, some: NearbySamples) -> _Candidates:
        """Predict gaps by all processes."""
        columns = some.markers[:, None]
        samples = clip.positions[some.frames, columns]
        origin, rotation = clip.local.at(some.markers, some.frames)
        local = ((samples - origin)[:, :, None] @ rotation)[:, :, 0]
        origin, rotation = clip.local.at(some.markers, some.inside)
        back = np.swapaxes(rotation, 2, 3)
        complete = np.where(np.isnan(origin).any(axis=(1, 2)), np.nan, 1.0)[:, None]
        positions, variance = [], []
        for weights in SampleWeights.of(some, clip.options.processes, clip.rate):
            unit = weights.variance[weights.pattern]
            in_world, scale = weights.predict(samples, some.used)
            positions.append(in_world)
            variance.append(unit * np.sqrt(scale)[:, None])
            in_frame, scale = weights.predict(local, some.used)
            positions.append((in_frame[:, :, None] @ back)[:, :, 0] + origin)
            variance.append(unit * np.sqrt(scale)[:, None] * complete)
        return cls(np.stack(positions), np.stack(variance))

    def of_rows(self, rows: NDArray[np.intp]) -> _Candidates:
        """Return the candidates of some gaps."""
        return _Candidates(self.positions[:, rows], self.variance[:, rows])

    def combined(self, factor: _Floats, power_of_error: float) -> tuple[_Floats, _Floats]:
        """Return the weighted mean of the candidates, and its expected rms error.

        Parameters
        ----------
        factor : ndarray [shape=(candidates,)]
            Of the variances; NaN for a candidate that is not used.
        power_of_error : float
            See `ShortGapOptions.weight_power`.
        """
        square = self.variance * factor[:, None, None]
        error = np.sqrt(square.mean(axis=2))
        error = np.where(np.isnan(error), np.inf, np.maximum(error, MIN_ERROR))
        weight = power_weights(error, power_of_error)
        used = weight[..., None] > 0.0
        mean = (weight[..., None, None] * np.where(used[..., None], self.positions, 0.0)).sum(0)
        expected = (weight[..., None] * np.where(used, square, 0.0)).sum(axis=0)
        return mean, np.sqrt(expected)


@dataclass(frozen=True, eq=False)
class _HeldOutError:
    """The errors of a marker's blocks of one length.

    Attributes
    ----------
    factor : ndarray [shape=(candidates,)]
        Of the variances of each candidate.
    calibration : float
        Factor of the expected error of the combination.
    bound_factor : float
        See `ShortGapEstimate`.
    """

    factor: _Floats
    calibration: float
    bound_factor: float


def _held_out_errors(clip: _Clip, blocks: NearbySamples) -> Iterator[tuple[int, _HeldOutError]]:
    """Yield each marker with enough blocks, and its errors."""
    options = clip.options
    candidates = _Candidates.of(clip, blocks)
    truth = clip.positions[blocks.inside, blocks.markers[:, None]]
    measured = ~np.isnan(truth[..., 0])
    square = ((candidates.positions - truth) ** 2).sum(axis=3)
    for rows in rows_by_marker(blocks.markers):
        if len(rows) < options.min_blocks:
            continue
        inside = measured[rows]
        own = candidates.of_rows(rows)
        ratio = square[:, rows] / own.variance
        known = inside & ~np.isnan(ratio)
        count = known.sum(axis=(1, 2))
        factor = np.where(known, ratio, 0.0).sum(axis=(1, 2)) / np.maximum(count, 1)
        enough = 2 * count >= inside.sum()  # local frames are seldom missing
        factor = np.where(enough, np.maximum(factor, MIN_ERROR**2), np.nan)
        mean, expected = own.combined(factor, options.weight_power)
        error = np.sqrt(((mean - truth[rows]) ** 2).sum(axis=2))
        ratio = (error / expected)[inside]
        calibration, bound = calibrate(ratio, len(rows), options.prior_blocks, MIN_ERROR)
        yield int(blocks.markers[rows[0]]), _HeldOutError(factor, calibration, bound)


def _estimates(
    clip: _Clip, some: NearbySamples, errors: Mapping[tuple[int, int], _HeldOutError]
) -> Iterator[ShortGapEstimate]:
    """Yield the estimates of the gaps whose error is known."""
    block = _block_length(some.length)
    candidates = _Candidates.of(clip, some)
    for rows in rows_by_marker(some.markers):
        marker = int(some.markers[rows[0]])
        error = errors.get((marker, block))
        if error is None:
            continue
        mean, expected = candidates.of_rows(rows).combined(error.factor, clip.options.weight_power)
        expected = np.maximum(expected * error.calibration, MIN_ERROR)
        for row, positions, rms in zip(rows, mean, expected, strict=True):
            start = int(some.starts[row])
            gap = Gap(start, start + some.length, marker)
            yield ShortGapEstimate(gap, positions, rms, error.bound_factor)

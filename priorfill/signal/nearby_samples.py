"""Gaussian processes of time through the few samples nearest to gaps, for many gaps at once.

The process is that of `priorfill.signal.gp_interpolation`: a free line plus a Matérn process. Its
smoothness makes it nearly Markovian, so that a few samples on either side of a gap predict it as
well as all of them. The weights of the samples depend on their times alone. Gaps with the same
pattern of samples have the same weights, whatever the marker and its path.

References
----------
.. [RW06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.kernels import Pairs
from priorfill.gp.linalg import solve_blocks
from priorfill.gp.process import GaussianProcess
from priorfill.signal.gp_interpolation import MIN_SAMPLES_PER_SIDE

__all__ = ["NearbySamples", "SampleWeights", "rows_by_marker"]

MIN_SCALE = 1e-9
"""mm². Least scale of a process: that of a marker that does not move is 0."""

MAX_SYSTEMS = 2000
"""Patterns whose systems are solved at a time: 20 MB."""

UNUSED = np.iinfo(np.intp).min
"""Offset of a sample that is not used."""

_Floats = NDArray[np.float64]
_Ints = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class NearbySamples:
    """The samples nearest to gaps of one length.

    Attributes
    ----------
    markers, starts : ndarray of int [shape=(gaps,)]
        The marker and the first frame of each gap.
    length : int
        Frames of each gap.
    frames : ndarray of int [shape=(gaps, 2 * samples per side)]
        Frames of the samples, ascending where they are used.
    used : ndarray of bool [shape=(gaps, 2 * samples per side)]
        Which of them are near enough to be used.
    """

    markers: _Ints
    starts: _Ints
    length: int
    frames: _Ints
    used: NDArray[np.bool_]

    @classmethod
    def of(
        cls,
        known: Mapping[int, _Ints],
        gaps: tuple[_Ints, _Ints],
        length: int,
        per_side: int,
        context: int,
    ) -> NearbySamples:
        """Find the samples nearest to gaps; gaps with too few on a side are left out.

        Parameters
        ----------
        known : mapping of int to ndarray of int
            For each marker the frames in which it is known, ascending. Those in a gap are not used.
        gaps : pair of ndarray of int [shape=(gaps,)]
            Marker and first frame of each gap; those of a marker must follow each other.
        length : int
            Frames of each gap.
        per_side : int
            Samples on either side.
        context : int
            Frames within which a sample must be.

        Examples
        --------
        >>> import numpy as np
        >>> known = {3: np.array([0, 1, 2, 5, 6, 30])}
        >>> near = NearbySamples.of(known, (np.array([3]), np.array([3])), 2, 3, 20)
        >>> near.frames[near.used]
        array([0, 1, 2, 5, 6])
        """
        markers, starts = gaps
        frames = np.zeros((len(starts), 2 * per_side), dtype=np.intp)
        used = np.zeros(frames.shape, dtype=bool)
        for rows in rows_by_marker(markers):
            own = known[int(markers[rows[0]])]
            before = np.searchsorted(own, starts[rows])[:, None] - np.arange(per_side, 0, -1)
            after = np.searchsorted(own, starts[rows] + length)[:, None] + np.arange(per_side)
            place = np.concatenate([before, after], axis=1)
            used[rows] = (place >= 0) & (place < len(own))
            if len(own):
                frames[rows] = own[np.clip(place, 0, len(own) - 1)]
        elapsed = np.maximum(
            starts[:, None] - frames, frames - (starts + length - 1)[:, None]
        )  # frames from the gap
        used &= elapsed <= context
        enough = (used[:, :per_side].sum(axis=1) >= MIN_SAMPLES_PER_SIDE) & (
            used[:, per_side:].sum(axis=1) >= MIN_SAMPLES_PER_SIDE
        )
        return cls(markers[enough], starts[enough], length, frames[enough], used[enough])

    @property
    def inside(self) -> _Ints:
        """Frames of the gaps [shape=(gaps, length)]."""
        return self.starts[:, None] + np.arange(self.length)


@dataclass(frozen=True, eq=False)
class SampleWeights:
    """Predictions of one process from nearby samples, as linear and quadratic forms of these.

    Attributes
    ----------
    weights : ndarray [shape=(patterns, length, samples)]
        The prediction is their product with the samples.
    variance : ndarray [shape=(patterns, length)]
        Of the prediction, noise included, in units of the process's own variance.
    precision : ndarray [shape=(patterns, samples, samples)]
        Its quadratic form of the samples, divided by the degrees of freedom, is the scale of the
        process (restricted maximum likelihood).
    pattern : ndarray of int [shape=(gaps,)]
        The pattern of each gap.
    """

    weights: _Floats
    variance: _Floats
    precision: _Floats
    pattern: _Ints

    @classmethod
    def of(
        cls, samples: NearbySamples, processes: tuple[GaussianProcess, ...], rate: float
    ) -> list[SampleWeights]:
        """Return the weights of each process, which differ in their noise variance alone.

        Parameters
        ----------
        samples : NearbySamples
            Of the gaps.
        processes : tuple of GaussianProcess
            Of one kernel of time; time in s.
        rate : float
            Hz.
        """
        offsets = np.where(samples.used, samples.frames - samples.starts[:, None], UNUSED)
        patterns, pattern = np.unique(offsets, axis=0, return_inverse=True)
        found = []
        for process in processes:
            parts = [
                _solve(patterns[first : first + MAX_SYSTEMS], samples.length, process, rate)
                for first in range(0, max(len(patterns), 1), MAX_SYSTEMS)
            ]
            weights, variance, precision = (
                np.concatenate(some) for some in zip(*parts, strict=True)
            )
            found.append(cls(weights, variance, precision, pattern.reshape(-1)))
        return found

    def predict(self, samples: _Floats, used: NDArray[np.bool_]) -> tuple[_Floats, _Floats]:
        """Predict gaps from their samples.

        Parameters
        ----------
        samples : ndarray [shape=(gaps, samples, 3), mm]
            Anything where they are not used.
        used : ndarray of bool [shape=(gaps, samples)]
            As of `NearbySamples`.

        Returns
        -------
        positions : ndarray [shape=(gaps, length, 3), mm]
        scale : ndarray [shape=(gaps,), mm²]
            Mean variance of a coordinate in units of the process's own.
        """
        count = used.sum(axis=1)
        given = np.where(used[..., None], samples, 0.0)
        mean = given.sum(axis=1) / count[:, None]
        centred = np.where(used[..., None], given - mean[:, None], 0.0)
        found = self.weights[self.pattern] @ centred + mean[:, None]
        product = self.precision[self.pattern] @ centred
        scale = (centred * product).sum(axis=(1, 2)) / (3.0 * np.maximum(count - 2, 1))
        return found, np.maximum(scale, MIN_SCALE)


def rows_by_marker(markers: _Ints) -> list[_Ints]:
    """Return the rows of each marker, which must follow each other.

    Examples
    --------
    >>> [list(map(int, rows)) for rows in rows_by_marker(np.array([3, 3, 5]))]
    [[0, 1], [2]]
    """
    if not len(markers):
        return []
    return np.split(np.arange(len(markers)), np.flatnonzero(np.diff(markers)) + 1)


def _solve(
    patterns: _Ints, length: int, process: GaussianProcess, rate: float
) -> tuple[_Floats, _Floats, _Floats]:
    """Return weights, variances and precisions of patterns [shape=(patterns, samples), frames].

    With C the covariance of the samples, H their line and X, h those of the requested frames, the
    weights are X C⁻¹ + (h - X C⁻¹ H) (H' C⁻¹ H)⁻¹ H' C⁻¹ [RW06]_ (Eq. 2.41, 2.42).
    """
    used = patterns != UNUSED
    centre = (length - 1) // 2
    frames = np.where(used, patterns - centre, 0)
    wanted = np.arange(length) - centre
    lags = np.abs(frames[:, :, None] - frames[:, None, :])
    to_wanted = np.abs(wanted[None, :, None] - frames[:, None, :])
    longest = 1 + int(max(lags.max(initial=0), to_wanted.max(initial=0)))
    kernel = process.kernel(Pairs.of_times(np.arange(longest) / rate, np.zeros(1)))[:, 0]
    both = used[:, :, None] & used[:, None, :]
    covariance = np.where(both, kernel[lags], 0.0)
    diagonal = np.arange(frames.shape[1])
    covariance[:, diagonal, diagonal] = np.where(used, kernel[0] + process.noise_variance, 1.0)
    cross = np.where(used[:, None, :], kernel[to_wanted], 0.0)
    identity = np.broadcast_to(np.eye(len(diagonal)), covariance.shape)
    inverse = solve_blocks(covariance, identity)
    line = np.stack([used.astype(np.float64), np.where(used, frames / rate, 0.0)], axis=2)
    projected = inverse @ line  # (patterns, samples, 2)
    coefficients = _inverse_of_two(np.swapaxes(line, 1, 2) @ projected)
    beyond = np.stack([np.ones(length), wanted / rate], axis=1) - cross @ projected
    to_line = coefficients @ np.swapaxes(projected, 1, 2)  # (patterns, 2, samples)
    explained = cross @ inverse
    variance = (
        kernel[0]
        + process.noise_variance
        - (explained * cross).sum(axis=2)
        + ((beyond @ coefficients) * beyond).sum(axis=2)
    )
    return (
        explained + beyond @ to_line,
        np.maximum(variance, process.noise_variance),
        inverse - projected @ to_line,
    )


def _inverse_of_two(matrices: _Floats) -> _Floats:
    """Return the inverses of symmetric matrices [shape=(patterns, 2, 2)]."""
    a, b, c = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 1]
    inverse = np.empty_like(matrices)
    inverse[:, 0, 0], inverse[:, 1, 1] = c, a
    inverse[:, 0, 1] = inverse[:, 1, 0] = -b
    inverse /= (a * c - b * b)[:, None, None]
    return inverse

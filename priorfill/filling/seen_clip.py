"""What methods see of a clip: without samples in doubt, and without ends that show too little.

A short run of samples in doubt within the measured path of a marker is interpolated over time.
Without that, a spike of one frame would make its marker one that is not visible throughout, and
methods would do without the marker, or without the frames around it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts import Artefact, artefact_samples
from priorfill.artefacts.artefact import JUMP, MISLABELLED, SPIKE
from priorfill.clip import Clip
from priorfill.filling.plausibility_options import PlausibilityOptions
from priorfill.filling.visible_range import OUTSIDE_VISIBLE, visible_range
from priorfill.gaps import Gap, GapGroup, find_gaps, gap_groups
from priorfill.geometry.axes import to_upright
from priorfill.markers.clip_geometry import ClipGeometry
from priorfill.markers.marker_set import MarkerSet
from priorfill.methods.task import Estimate, Note
from priorfill.signal.gp_interpolation import InterpolationOptions, interpolate_gap

__all__ = ["SeenClip", "doubtful_samples"]

CLEARLY_WRONG = 0.5
"""Deviation of a distance, as a share of it, from which a long run is wrong in any posture."""


@dataclass(frozen=True, eq=False)
class SeenClip:
    """The part of a clip that methods see.

    Attributes
    ----------
    clip : Clip
        The clip to be filled.
    hidden : ndarray of bool [shape=(frames, markers)]
        Measured samples that methods do not see.
    definition : MarkerSet or None
        Definition of the marker set; None if it is unknown.
    extrapolate : int
        Frames beyond the first and the last one with enough visible markers that are seen.
    interpolate_seconds : float
        s. Longest run of hidden samples that is interpolated.
    """

    clip: Clip
    hidden: NDArray[np.bool_]
    definition: MarkerSet | None
    extrapolate: int = 0
    interpolate_seconds: float = PlausibilityOptions.interpolate_seconds

    @cached_property
    def frames(self) -> tuple[int, int]:
        """The frames that are seen: ``start <= frame < stop``."""
        start, stop = visible_range(~(self.clip.missing | self.hidden), self.extrapolate)
        return (start, stop) if start < stop else (0, self.clip.frames)

    @cached_property
    def geometry(self) -> ClipGeometry:
        """Upright positions of the frames that are seen, without hidden samples."""
        start, stop = self.frames
        positions = self.clip.positions[start:stop]
        if self.hidden.any():
            hidden = self.hidden[start:stop]
            positions = np.where(hidden[..., None], np.nan, positions)
            self._interpolate(positions, hidden)
        return ClipGeometry(to_upright(positions, self.clip.up), self.clip.labels, self.definition)

    def _interpolate(self, positions: NDArray[np.float64], hidden: NDArray[np.bool_]) -> None:
        """Interpolate short runs of hidden samples in place, where both neighbours are seen.

        Parameters
        ----------
        positions : ndarray [shape=(frames, markers, 3), mm]
            NaN where missing or hidden.
        hidden : ndarray of bool [shape=(frames, markers)]
            Which of them are hidden.
        """
        options = InterpolationOptions(max_seconds=self.interpolate_seconds)
        for gap in find_gaps(np.isnan(positions[..., 0])):
            path = positions[:, gap.marker]
            if hidden[gap.start : gap.stop, gap.marker].all():
                found = interpolate_gap(path, gap.start, gap.stop, self.clip.rate, options)
                if found is not None:
                    path[gap.start : gap.stop] = found[0]

    def groups(self, left_alone: Sequence[tuple[Gap, str]]) -> tuple[GapGroup, ...]:
        """Return the gap groups that are seen and have a sample to fill.

        Parameters
        ----------
        left_alone : sequence of (Gap, str)
            Missing samples of the clip that are not to be filled.
        """
        wanted = self.clip.missing
        for gap, _ in left_alone:
            wanted[gap.start : gap.stop, gap.marker] = False
        start, stop = self.frames
        wanted = wanted[start:stop]
        return tuple(
            group
            for group in gap_groups(~self.geometry.valid)
            if any(wanted[gap.start : gap.stop, gap.marker].any() for gap in group.gaps)
        )

    def in_whole_clip(self, estimate: Estimate) -> Estimate:
        """Return an estimate for the frames that are seen as one for all frames.

        Parameters
        ----------
        estimate : Estimate
            Of a task of the frames that are seen.

        Returns
        -------
        Estimate
            With a note for each run of samples at the ends that are not seen.
        """
        start, stop = self.frames
        if (start, stop) == (0, self.clip.frames):
            return estimate
        shape = (self.clip.frames, len(self.clip.labels))
        outside = self.clip.missing
        outside[start:stop] = False
        bound = estimate.error_bound_90
        return Estimate(
            _with_ends(estimate.positions, (*shape, 3), start),
            _with_ends(estimate.expected_rms, shape, start),
            [
                *(replace(n, start=n.start + start, stop=n.stop + start) for n in estimate.notes),
                *(
                    Note(gap.marker, gap.start, gap.stop, OUTSIDE_VISIBLE, filled=False)
                    for gap in find_gaps(outside)
                ),
            ],
            None if bound is None else _with_ends(bound, shape, start),
        )


def doubtful_samples(
    clip: Clip, artefacts: Sequence[Artefact], options: PlausibilityOptions
) -> NDArray[np.bool_]:
    """Return the measured samples that methods are not to see.

    Parameters
    ----------
    clip : Clip
        The clip.
    artefacts : sequence of Artefact
        As found in it.
    options : PlausibilityOptions
        Which of them count.

    Returns
    -------
    ndarray of bool [shape=(frames, markers)]
    """
    nothing = np.zeros((clip.frames, len(clip.labels)), dtype=bool)
    if not options.hide_doubtful:
        return nothing
    missing = clip.missing
    column = {label: marker for marker, label in enumerate(clip.labels)}
    counted = [
        one
        for one in artefacts
        if _is_hidden(one, missing[:, [column[label] for label in one.markers]], clip.rate, options)
    ]
    if not counted:
        return nothing
    return artefact_samples(counted, clip.labels, clip.frames) & ~missing


def _is_hidden(
    artefact: Artefact, missing: NDArray[np.bool_], rate: float, options: PlausibilityOptions
) -> bool:
    """Check whether methods are not to see the samples of an artefact.

    Parameters
    ----------
    artefact : Artefact
        The artefact.
    missing : ndarray of bool [shape=(frames, markers of the artefact)]
        Which samples are missing.
    rate : float
        Hz.
    options : PlausibilityOptions
        Which artefacts count.
    """
    if _share_of_marker(artefact, missing) > options.max_doubtful_share:
        return False
    if artefact.kind in (JUMP, MISLABELLED):
        off = abs(artefact.distance - artefact.typical_distance)
        return (
            artefact.stop - artefact.start <= options.max_doubtful_seconds * rate
            or off > CLEARLY_WRONG * artefact.typical_distance
        )
    reach = round(options.suspect_seconds * rate)
    return _is_clear(artefact, rate, options) or _is_near_gap(artefact, missing, reach)


def _is_clear(artefact: Artefact, rate: float, options: PlausibilityOptions) -> bool:
    """Check whether an artefact is no spike, or a short and large one."""
    if artefact.kind != SPIKE:
        return True
    off = abs(artefact.distance - artefact.typical_distance)  # NaN without a reference marker
    large = artefact.size >= options.min_spike or off >= options.min_spike
    return large and artefact.stop - artefact.start <= options.max_spike_seconds * rate


def _share_of_marker(artefact: Artefact, missing: NDArray[np.bool_]) -> float:
    """Return the share of the measured samples of a marker that an artefact has."""
    inside = (~missing[artefact.start : artefact.stop]).sum(axis=0)
    measured = len(missing) - np.count_nonzero(missing, axis=0)
    return float((inside / np.maximum(measured, 1)).max())


def _is_near_gap(artefact: Artefact, missing: NDArray[np.bool_], reach: int) -> bool:
    """Check whether a marker of an artefact is missing within a number of frames from it."""
    near = slice(max(artefact.start - reach, 0), artefact.stop + reach)
    return bool(missing[near].any())


def _with_ends(
    values: NDArray[np.float64], shape: tuple[int, ...], start: int
) -> NDArray[np.float64]:
    """Return values [shape=(frames seen, ...)] within an array of all frames, NaN elsewhere."""
    whole = np.full(shape, np.nan)
    whole[start : start + len(values)] = values
    return whole

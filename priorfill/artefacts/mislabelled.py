"""Mislabelled markers: a label moves to another marker, whose own label is missing from then on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.label_swaps import MAX_MISS_RATIO
from priorfill.artefacts.marker_path import known_medians, thinned_frames
from priorfill.artefacts.reference_markers import ReferenceMarkers, distances

__all__ = ["MislabelledRun", "find_mislabelled"]

RIGHT_SIDE_RATIO = 0.5
"""A label that is on its own marker after a break, and was on the other one before it, is farther
from its usual distances before it: those after it deviate by less than this fraction."""

COMPARED_FRAMES = 30
"""Frames before and after a break in which distances are compared."""


@dataclass(frozen=True)
class MislabelledRun:
    """Frames ``start <= frame < stop`` in which a label is on another marker.

    Attributes
    ----------
    marker, actual : int
        The marker that the label stands for, and the one it is on.
    start, stop : int
        Frames.
    jump : float
        mm by which the path jumps.
    """

    marker: int
    actual: int
    start: int
    stop: int
    jump: float


def find_mislabelled(
    positions: NDArray[np.float64],
    broken: NDArray[np.bool_],
    references: ReferenceMarkers,
    max_miss_ratio: float = MAX_MISS_RATIO,
) -> tuple[MislabelledRun, ...]:
    """Find labels that continue the path of another marker, which is missing then.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    broken : ndarray of bool [shape=(frames - 1, markers)]
        Where paths break.
    references : ReferenceMarkers
        Show on which side of a break a label is right.
    max_miss_ratio : float
        See `priorfill.artefacts.label_swaps.MAX_MISS_RATIO`.

    Returns
    -------
    tuple of MislabelledRun
        In order of time.

    See Also
    --------
    priorfill.artefacts.find_artefacts : Calls all detectors.
    find_label_swaps : Where both labels change.
    """
    frames = len(positions)
    backward = [
        MislabelledRun(run.marker, run.actual, frames - run.stop, frames - run.start, run.jump)
        for run in _find_forward(positions[::-1], broken[::-1], references, max_miss_ratio)
    ]
    forward = _find_forward(positions, broken, references, max_miss_ratio)
    found = dict.fromkeys([*forward, *backward])
    return tuple(sorted(found, key=lambda run: (run.start, run.marker, run.actual)))


def _find_forward(
    positions: NDArray[np.float64],
    broken: NDArray[np.bool_],
    references: ReferenceMarkers,
    max_miss_ratio: float,
) -> list[MislabelledRun]:
    """Return the runs that begin at a break, in the order of the frames given."""
    breaks = np.argwhere(broken).tolist()
    if not breaks:
        return []
    seen = ~np.isnan(positions[:, :, 0])
    found = []
    for frame, marker in breaks:
        if frame == 0 or not seen[frame - 1, marker]:
            continue
        lost = np.flatnonzero(seen[frame] & seen[frame - 1] & ~seen[frame + 1])
        if not len(lost):
            continue
        here = positions[frame + 1, marker]
        expected = 2.0 * positions[frame] - positions[frame - 1]
        jump = float(np.linalg.norm(here - expected[marker]))
        misses = np.linalg.norm(here - expected[lost], axis=1)
        if misses.min() < max_miss_ratio * jump and not _is_right_after(
            positions, references, marker, frame + 1
        ):
            actual = int(lost[misses.argmin()])
            ends = seen[frame + 1 :, actual] | ~seen[frame + 1 :, marker]
            ends[1:] |= broken[frame + 1 :, marker]
            length = int(ends.argmax()) if ends.any() else len(ends)
            found.append(MislabelledRun(marker, actual, frame + 1, frame + 1 + length, jump))
    return found


def _is_right_after(
    positions: NDArray[np.float64], references: ReferenceMarkers, marker: int, frame: int
) -> bool:
    """Return whether a marker's distances are usual after a break, and were not before it."""
    others = references.of(marker)
    typical = known_medians(thinned_frames(distances(positions, marker, others)))
    sides = slice(max(frame - COMPARED_FRAMES, 0), frame), slice(frame, frame + COMPARED_FRAMES)
    before, after = (
        known_medians(np.abs(distances(positions[side], marker, others) - typical))
        for side in sides
    )
    known = ~np.isnan(before) & ~np.isnan(after)
    return bool(known.any() and after[known].sum() < RIGHT_SIDE_RATIO * before[known].sum())

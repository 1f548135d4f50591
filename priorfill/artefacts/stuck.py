"""Stuck markers: exactly the same position in several frames while the reference markers move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.reference_markers import ReferenceMarkers, distances
from priorfill.gaps import runs
from priorfill.runtime.option_checks import check_at_least
from priorfill.runtime.threads import by_frames

__all__ = ["StuckOptions", "StuckRun", "find_stuck"]


@dataclass(frozen=True)
class StuckOptions:
    """When a marker counts as stuck.

    Attributes
    ----------
    min_frames : int
        Equal samples in a row. Measured floating-point numbers are never equal three times in a
        row; coarse integers are, and are told apart by the reference markers.
    min_reference_shift : float
        mm. Distance that half of the reference markers move away meanwhile: well above noise and
        the sway of a standing person.
    min_distance_change : float
        mm. Change of the distance from a reference marker: in a file of coarse numbers, a foot
        that turns about a marker at rest changes none.
    """

    min_frames: int = 4
    min_reference_shift: float = 5.0
    min_distance_change: float = 2.0

    def __post_init__(self) -> None:
        check_at_least(self, 2, "min_frames")
        check_at_least(self, 0.0, "min_reference_shift", "min_distance_change")


@dataclass(frozen=True)
class StuckRun:
    """Frames ``start <= frame < stop`` in which a marker is stuck.

    Attributes
    ----------
    marker, start, stop : int
        The marker and the frames.
    reference : int
        The reference marker that moves farthest meanwhile.
    shift : float
        mm. How far it moves.
    """

    marker: int
    start: int
    stop: int
    reference: int
    shift: float


def _all_equal(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which samples are equal [shape=(frames, markers)]."""
    # one coordinate at a time: a third of the time needed for all at once
    equal: NDArray[np.bool_] = one[:, :, 0] == other[:, :, 0]
    for axis in (1, 2):
        equal &= one[:, :, axis] == other[:, :, axis]
    return equal


def find_stuck(
    positions: NDArray[np.float64],
    references: ReferenceMarkers,
    options: StuckOptions = StuckOptions(),
) -> list[StuckRun]:
    """Find the runs of equal samples that no moving body produces.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    references : ReferenceMarkers
    options : StuckOptions

    Returns
    -------
    list of StuckRun
        By marker, then by time.

    See Also
    --------
    priorfill.artefacts.find_artefacts : Calls all detectors.
    """
    equal = np.concatenate(by_frames(_all_equal, positions[1:], positions[:-1]))
    min_steps = options.min_frames - 1
    found = []
    for marker in np.flatnonzero(equal.sum(axis=0) >= min_steps).tolist():
        others = references.of(marker)
        spans = np.array(list(runs(equal[:, marker])), dtype=np.intp).reshape(-1, 2)
        spans = spans[spans[:, 1] - spans[:, 0] >= min_steps]
        spans = spans[_references_move(positions[:, others], spans, options.min_reference_shift)]
        for start, last in spans.tolist():
            distance = distances(positions[start : last + 1], marker, others)
            change = np.abs(distance - distance[:1])
            if np.nanmax(change, initial=0.0) > options.min_distance_change:
                path = positions[start : last + 1, others]
                shift = np.nan_to_num(np.sqrt(((path - path[:1]) ** 2).sum(axis=2))).max(axis=0)
                best = int(shift.argmax())
                found.append(
                    StuckRun(marker, start, last + 1, int(others[best]), float(shift[best]))
                )
    return found


def _references_move(
    references: NDArray[np.float64], spans: NDArray[np.intp], min_shift: float
) -> NDArray[np.bool_]:
    """Return whether half of the references leave their place in each span (first, last frame)."""
    start, last = spans.T
    moved = np.zeros((len(spans), references.shape[1]), dtype=bool)
    here = references[start]
    for frame in (last, (start + last) // 2):  # one that returns is away in the middle
        square = ((references[frame] - here) ** 2).sum(axis=2)
        moved |= np.nan_to_num(square) > min_shift**2
    result: NDArray[np.bool_] = (2 * moved.sum(axis=1) >= moved.shape[1]) & moved.any(axis=1)
    return result

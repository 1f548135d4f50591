"""Distance outliers: samples farther from the reference markers than the body allows.

A marker can leave its place without a break: some programs lead its path smoothly to a reflection
and back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.marker_path import known_quantiles
from priorfill.artefacts.reference_markers import ReferenceMarkers, distances, sample_poses
from priorfill.runtime.option_checks import check_at_least, check_between
from priorfill.runtime.threads import map_in_threads

__all__ = ["DistanceOutlierOptions", "distance_outliers"]

STRIDE = 4
"""Frames between the samples that are examined first. A marker that is too far away for fewer
frames than this is a spike, and found by its breaks."""


BATCH_SIZE = 200
"""Frames examined at once; temporary arrays of more of them leave the processor's cache."""


@dataclass(frozen=True)
class DistanceOutlierOptions:
    """Which distances are too large.

    Attributes
    ----------
    quantile : float
        Quantile of a distance over the clip taken as its normal maximum: in a quarter of the clip
        one of the two markers may be away.
    max_ratio : float
        Multiple of the normal maximum that a distance may reach. In 331 recordings of HDM05, CMU
        and gait no two reference markers were farther away at once, except in artefacts.
    margin : float
        mm. Added to that, since two markers at one joint may stay close during most of a clip.
    single_reference_factor : float
        Factor on the limit where only one reference marker is visible.
    """

    quantile: float = 0.75
    max_ratio: float = 1.3
    margin: float = 60.0
    single_reference_factor: float = 3.0

    def __post_init__(self) -> None:
        check_between(self, 0.0, 1.0, "quantile")
        check_at_least(self, 1.0, "max_ratio", "single_reference_factor")
        check_at_least(self, 0.0, "margin")


def distance_outliers(
    positions: NDArray[np.float64],
    references: ReferenceMarkers,
    options: DistanceOutlierOptions = DistanceOutlierOptions(),
) -> dict[int, NDArray[np.bool_]]:
    """Find the frames in which markers are too far from their reference markers.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    references : ReferenceMarkers
    options : DistanceOutlierOptions

    Returns
    -------
    dict
        For each marker that is ever too far away: in which frames, ndarray of bool
        [shape=(frames,)].

    See Also
    --------
    priorfill.artefacts.find_artefacts : Calls all detectors.
    choose_reference_markers : Chooses the reference markers.
    """
    poses = np.unique(sample_poses(len(positions)))
    normal = known_quantiles(_all_distances(positions[poses], references), options.quantile)
    limit = options.max_ratio * normal + options.margin
    limit[~references.known] = np.nan
    factor = options.single_reference_factor

    def suspected_in(start: int) -> NDArray[np.bool_]:
        batch = positions[start : start + BATCH_SIZE * STRIDE : STRIDE]
        far = _too_far(_all_distances(batch, references), limit, factor)
        found: NDArray[np.bool_] = np.logical_or.reduce(far, axis=0)
        return found

    suspect = np.zeros(positions.shape[1], dtype=bool)
    with map_in_threads(positions.size) as mapped:
        for found in mapped(suspected_in, range(0, len(positions), BATCH_SIZE * STRIDE)):
            suspect |= found
    suspects = np.flatnonzero(suspect).tolist()
    distance = {m: distances(positions, m, references.others[m]) for m in suspects}
    suspected = {m: _too_far(distance[m], limit[m], factor) for m in suspects}
    outliers = {}
    for marker in suspects:
        # a reference marker that is too far away itself does not count
        for column, other in enumerate(references.others[marker].tolist()):
            if other in suspected:
                distance[marker][suspected[other], column] = np.nan
        far = _too_far(distance[marker], limit[marker], factor)
        if far.any():
            outliers[marker] = far
    return outliers


def _all_distances(
    positions: NDArray[np.float64], references: ReferenceMarkers
) -> NDArray[np.float64]:
    """Return distances from the reference markers [shape=(frames, markers, references), mm]."""
    columns = []
    for other in references.others.T:
        difference = positions[:, other] - positions
        columns.append(np.sqrt(np.einsum("fmc,fmc->fm", difference, difference)))
    return np.stack(columns, axis=2)


def _too_far(
    distance: NDArray[np.float64], limit: NDArray[np.float64], single_reference_factor: float
) -> NDArray[np.bool_]:
    """Return where more than half of the visible references, and at least two, are too far.

    Where a single reference is visible, it alone decides, by a higher limit.
    """
    known = ~np.isnan(distance - limit)
    with np.errstate(invalid="ignore"):
        exceeded = (distance > limit) & known
        far_exceeded = (distance > single_reference_factor * limit) & known
    visible, count = known.sum(axis=-1), exceeded.sum(axis=-1)
    far: NDArray[np.bool_] = ((count >= 2) & (2 * count > visible)) | (
        (visible == 1) & far_exceeded.any(axis=-1)
    )
    return far

"""Samples that are farther from the marker's partners than its body reaches.

A marker may leave without a break: some programs lead its path smoothly to a reflection and back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.reference_markers import ReferenceMarkers, distances, sample_poses

__all__ = ["distance_outliers"]

REACH = 0.75
"""Quantile of a distance that tells how far apart two markers usually get at most: in a quarter of
the clip one of them may be away."""

STRETCH = 1.3
"""Times as far they are now and then. No distance to two partners at once was so large in 331 takes
of HDM05, CMU and gait, but where a marker was not itself."""

SLACK = 60.0
"""mm, added to that: two markers at one joint may stay close for most of a clip."""

LONE = 3.0
"""Times as much is needed where one partner alone can tell."""

STRIDE = 4
"""Frames. What is far away for less is a spike, with breaks."""


def distance_outliers(
    positions: NDArray[np.float64], partners: ReferenceMarkers
) -> dict[int, NDArray[np.bool_]]:
    """Return the markers that are ever too far away, and in which frames [shape=(frames,)].

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    partners : Partners
        Who judges whom.
    """
    poses = np.unique(sample_poses(len(positions)))
    reach = STRETCH * _high(_lengths(positions[poses], partners)) + SLACK
    reach[~partners.known] = np.nan
    some = _too_far(_lengths(positions[::STRIDE], partners), reach)
    suspects = np.flatnonzero(some.any(axis=0)).tolist()
    length = {m: distances(positions, m, partners.others[m]) for m in suspects}
    accused = {m: _too_far(length[m], reach[m]) for m in suspects}
    found = {}
    for marker in suspects:
        # who is too far away itself is no judge
        for column, other in enumerate(partners.others[marker].tolist()):
            if other in accused:
                length[marker][accused[other], column] = np.nan
        far = _too_far(length[marker], reach[marker])
        if far.any():
            found[marker] = far
    return found


def _lengths(positions: NDArray[np.float64], partners: ReferenceMarkers) -> NDArray[np.float64]:
    """Return how far each marker is from its partners [shape=(frames, markers, partners), mm]."""
    columns = []
    for other in partners.others.T:
        apart = positions[:, other] - positions
        columns.append(np.sqrt(np.einsum("fmc,fmc->fm", apart, apart)))
    return np.stack(columns, axis=2)


def _high(length: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quantile `REACH` over the frames; NaN where nothing is known."""
    ordered = np.sort(length, axis=0)  # NaN last
    count = (~np.isnan(ordered)).sum(axis=0)
    at = (REACH * np.maximum(count - 1, 0)).astype(np.intp)
    high: NDArray[np.float64] = np.take_along_axis(ordered, at[None], axis=0)[0]
    return high


def _too_far(length: NDArray[np.float64], reach: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where more than half of the partners that are seen, two at least, are too far."""
    known = ~np.isnan(length - reach)
    with np.errstate(invalid="ignore"):
        votes, lone = (length > reach) & known, (length > LONE * reach) & known
    seen, against = known.sum(axis=-1), votes.sum(axis=-1)
    far: NDArray[np.bool_] = ((against >= 2) & (2 * against > seen)) | (
        (seen == 1) & lone.any(axis=-1)
    )
    return far

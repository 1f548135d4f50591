"""Recognise one recording in two clips that share no sample bit for bit.

When a recording is exported twice, as C3D and as text, or in other units or axes, its samples are
rounded: the sketches of the two clips, which hash bits, have nothing in common. The lengths of the
clips agree, and so do the distances between markers, which do not depend on the axes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["RATE_TOLERANCE", "same_motion"]

RATE_TOLERANCE = 0.01
"""Maximum relative difference of two rates that may be the same, written with few digits."""

DISTANCE_TOLERANCE = 0.3
"""mm. Maximum change of a distance when coordinates are rounded to 0.1 mm, the usual step of
integer files."""

MIN_DISTANCES = 30
"""Minimum number of distances to compare."""

MIN_AGREEING_SHARE = 0.5
"""Minimum share of distances that agree. Samples that were filled, or filtered near a gap, may
differ. In two takes of the same subject few distances agree to 0.3 mm, as the compared markers are
on different segments."""


def same_motion(
    one: NDArray[np.float32],
    labels: Sequence[str],
    other: NDArray[np.float32],
    other_labels: Sequence[str],
) -> bool:
    """Return whether two clips are of one recording.

    Parameters
    ----------
    one, other : ndarray [shape=(frames, markers, 3), mm]
        At the same rate and of about the same length; NaN where missing.
    labels, other_labels : sequence of str
        Their markers; case does not matter.
    """
    index = {label.casefold(): marker for marker, label in enumerate(other_labels)}
    pairs = [(i, index[x.casefold()]) for i, x in enumerate(labels) if x.casefold() in index]
    frames = min(len(one), len(other))
    if len(pairs) < 2 or frames == 0:
        return False
    markers, other_markers = (list(column) for column in zip(*pairs, strict=True))
    # labels are usually listed from head to foot: markers half a list apart are far apart
    step = len(pairs) // 2
    distances = [
        np.linalg.norm(both - np.roll(both, step, axis=1), axis=2)
        for both in (one[:frames, markers], other[:frames, other_markers])
    ]
    difference = np.abs(distances[0] - distances[1])
    difference = difference[~np.isnan(difference)]
    return len(difference) >= MIN_DISTANCES and bool(
        (difference < DISTANCE_TOLERANCE).mean() >= MIN_AGREEING_SHARE
    )

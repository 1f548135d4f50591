"""Joint angles: of a filled clip against the true one.

An angle is that between the lines from a joint to the points above and below it, each the mean of
markers that the marker set names (`priorfill.markers.marker_set.MarkerSet.joints`): hip, knee and
ankle for
a knee. It follows flexion, but it is no anatomical angle: markers sit on the skin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.evaluation.gap_generator import Mask
from priorfill.markers.marker_set import MarkerSet

__all__ = ["angles", "joint_errors"]

Array = NDArray[np.float64]


def angles(first: Array, joint: Array, last: Array) -> Array:
    """Return the angle at a joint.

    Parameters
    ----------
    first, joint, last : ndarray [shape=(frames, 3), mm]
        Three points over time.

    Returns
    -------
    ndarray [shape=(frames,), degrees]
        0 to 180; NaN where a point is unknown or lies on the joint.
    """
    up, down = first - joint, last - joint
    across = np.linalg.norm(np.cross(up, down), axis=1)
    along = (up * down).sum(axis=1)
    # the tangent is exact near 0 and 180 degrees too, where the cosine is not
    found: Array = np.degrees(np.arctan2(across, along))
    nowhere = ~up.any(axis=1) | ~down.any(axis=1)
    return np.where(nowhere | np.isnan(along), np.nan, found)


def joint_errors(
    marker_set: MarkerSet,
    labels: tuple[str, ...],
    truth: Array,
    filled: Array,
    gone: Mask,
) -> dict[str, Array]:
    """Return how far off the angles of a filled clip are.

    Parameters
    ----------
    marker_set : MarkerSet
        Of the clip, with its own labels.
    labels : tuple of str
        The clip's markers.
    truth, filled : ndarray [shape=(frames, markers, 3), mm]
        The true and the filled clip.
    gone : ndarray of bool [shape=(frames, markers)]
        What was removed.

    Returns
    -------
    dict of str to ndarray [degrees]
        For each joint its errors, in the frames in which one of its markers was removed and both
        angles are known. Joints without such a frame are not there.
    """
    errors = {}
    for name, points in marker_set.joints.items():
        columns = [[labels.index(label) for label in point] for point in points]
        touched = gone[:, [i for point in columns for i in point]].any(axis=1)
        if not touched.any():
            continue
        true, ours = (
            angles(*(x[touched][:, point].mean(axis=1) for point in columns))
            for x in (truth, filled)
        )
        off = np.abs(ours - true)
        known = np.isfinite(off)
        if known.any():
            errors[name] = off[known]
    return errors

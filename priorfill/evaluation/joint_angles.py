"""Errors of joint angles: the filled clip compared with the true one.

A joint angle is the angle at a joint between the points above and below it, such as hip and ankle
for the knee. Each point is the mean of markers that the marker set names
(`priorfill.markers.marker_set.MarkerSet.joints`). These angles follow flexion, but are not
anatomical joint angles: the markers are on the skin.
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
        0 to 180; NaN where a point is missing or coincides with the joint.
    """
    up, down = first - joint, last - joint
    across = np.linalg.norm(np.cross(up, down), axis=1)
    along = (up * down).sum(axis=1)
    # the tangent is accurate near 0 and 180 degrees, unlike the cosine
    found: Array = np.degrees(np.arctan2(across, along))
    coincident = ~up.any(axis=1) | ~down.any(axis=1)
    return np.where(coincident | np.isnan(along), np.nan, found)


def joint_errors(
    marker_set: MarkerSet,
    labels: tuple[str, ...],
    truth: Array,
    filled: Array,
    removed: Mask,
) -> dict[str, Array]:
    """Return the absolute errors of the joint angles of a filled clip.

    Parameters
    ----------
    marker_set : MarkerSet
        The clip's marker set, with the clip's own labels.
    labels : tuple of str
        The clip's markers.
    truth, filled : ndarray [shape=(frames, markers, 3), mm]
        The true and the filled clip.
    removed : ndarray of bool [shape=(frames, markers)]
        Samples that were removed.

    Returns
    -------
    dict of str to ndarray [degrees]
        Errors by joint, in the frames in which one of its markers was removed and both angles are
        known. Joints without such a frame are left out.
    """
    errors = {}
    for name, points in marker_set.joints.items():
        columns = [[labels.index(label) for label in point] for point in points]
        touched = removed[:, [i for point in columns for i in point]].any(axis=1)
        if not touched.any():
            continue
        true_angles, filled_angles = (
            angles(*(x[touched][:, point].mean(axis=1) for point in columns))
            for x in (truth, filled)
        )
        off = np.abs(filled_angles - true_angles)
        known = np.isfinite(off)
        if known.any():
            errors[name] = off[known]
    return errors

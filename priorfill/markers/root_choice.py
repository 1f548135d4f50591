"""Choose the markers that define the root frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootGroup, root_group
from priorfill.markers.marker_set import MarkerSet

__all__ = ["choose_root"]

MIN_ROOT_EXTENT = 30.0
"""mm. Horizontal rms extent that a group needs to determine the heading: at this size, noise of
1 mm turns it by 2 degrees."""


MIN_ROOT_MARKERS = 3
"""Markers that a segment needs to be a root group."""


def _horizontal_extent(group: RootGroup) -> float:
    """Return the horizontal rms distance (mm) of a group's markers from their centroid."""
    flat = group.template[:, :2]
    return float(np.sqrt(((flat - flat.mean(axis=0)) ** 2).sum(axis=1).mean()))


def choose_root(
    marker_set: MarkerSet,
    labels: Sequence[str],
    positions: NDArray[np.float64],
    valid: NDArray[np.bool_],
) -> RootGroup | None:
    """Choose the markers that define the root frames of a gap group.

    Parameters
    ----------
    marker_set : MarkerSet
        Segments, and which of them are preferred.
    labels : sequence of str
        The clip's labels.
    positions : ndarray [shape=(frames, markers, 3), mm]
        The upright clip, from which the template is computed.
    valid : ndarray of bool [shape=(markers,)]
        Markers that are valid in all frames of interest.

    Returns
    -------
    RootGroup or None
        The first of the marker set's root segments, then of its other segments by size, with
        three valid markers that determine a heading. If there is none, all valid markers together,
        which determine it less exactly; None if fewer than two are valid.

    See Also
    --------
    priorfill.geometry.root_frames.root_group : Computes the template.
    """
    segments: dict[str, list[int]] = {}
    for marker, label in enumerate(labels):
        if valid[marker]:
            segments.setdefault(marker_set.segment.get(label, ""), []).append(marker)
    ordered = [name for name in marker_set.root_segments if name in segments]
    ordered += sorted((s for s in segments if s not in ordered), key=lambda s: -len(segments[s]))
    for name in ordered:
        if len(segments[name]) >= MIN_ROOT_MARKERS:
            group = root_group(positions, segments[name])
            if group is not None and _horizontal_extent(group) >= MIN_ROOT_EXTENT:
                return group
    everything = np.flatnonzero(valid)
    if len(everything) < 2:
        return None
    return root_group(positions, [int(m) for m in everything])

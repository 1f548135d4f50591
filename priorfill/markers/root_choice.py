"""Choose the markers of the root frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import (
    RootGroup,
    root_group,
)
from priorfill.markers.marker_set import MarkerSet

__all__ = ["choose_root"]

MIN_ROOT_SPREAD = 30.0
"""Horizontal rms spread (mm) below which a group tells no heading: marker noise of 1 mm would
turn it by 2 degrees."""


MIN_ROOT_MARKERS = 3
"""Fewest markers of a segment that make a root group."""


def _spread(group: RootGroup) -> float:
    """Horizontal rms distance of a group's markers from their centroid, mm."""
    flat = group.template[:, :2]
    return float(np.sqrt(((flat - flat.mean(axis=0)) ** 2).sum(axis=1).mean()))


def choose_root(
    marker_set: MarkerSet,
    labels: Sequence[str],
    positions: NDArray[np.float64],
    valid: NDArray[np.bool_],
) -> RootGroup | None:
    """Choose the rigid group that gives a gap group's root frame.

    Parameters
    ----------
    marker_set : MarkerSet
        Segments, and which of them to prefer as a root.
    labels : sequence of str
        The clip's labels.
    positions : ndarray [shape=(frames, markers, 3), mm]
        The clip, upright: the templates are learnt from it.
    valid : ndarray of bool [shape=(markers,)]
        Markers that are valid in all frames concerned.

    Returns
    -------
    RootGroup or None
        The first of the marker set's root segments, then of its other segments, that has
        three valid markers and tells a heading; else all valid markers together, which tell a
        rougher one; None where fewer than two markers are valid.
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
            if group is not None and _spread(group) >= MIN_ROOT_SPREAD:
                return group
    everything = np.flatnonzero(valid)
    if len(everything) < 2:
        return None
    return root_group(positions, [int(m) for m in everything])

"""Describe all markers of a clip: by a definition, by its data, or both."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.geometry.distances import PairStatistics, pair_statistics
from priorfill.geometry.rigid_groups import MIN_COMMON
from priorfill.markers.definitions import (
    recognise,
)
from priorfill.markers.discover import (
    discover,
)
from priorfill.markers.marker_set import (
    Joint,
    MarkerSet,
)

__all__ = ["describe", "describe_markers"]


def describe(clip: Clip, definition: MarkerSet | None = None) -> MarkerSet:
    """Return the marker set of a clip: exactly its markers, under its own labels.

    Parameters
    ----------
    clip : Clip
        The clip.
    definition : MarkerSet, optional
        The set it belongs to; by default the one that its labels are recognised as.

    Returns
    -------
    MarkerSet
        See `describe_markers`.

    Raises
    ------
    MarkerSetError
        Where a definition file is malformed.
    """
    return describe_markers(
        clip.labels,
        clip.positions,
        definition or recognise(clip.labels),
        lambda: pair_statistics(clip.positions),
    )


def describe_markers(
    labels: Sequence[str],
    positions: NDArray[np.floating],
    definition: MarkerSet | None,
    pairs: Callable[[], PairStatistics],
) -> MarkerSet:
    """Return the marker set of some markers, by a definition, by their motion, or both.

    Parameters
    ----------
    labels : sequence of str
        The markers.
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    definition : MarkerSet or None
        The set they belong to; None if it is unknown.
    pairs : callable
        Returns the statistics of the markers' distances; called only if they are needed.

    Returns
    -------
    MarkerSet
        The definition without the markers that are not there. Markers that it does not know are
        assigned to the segment to which their distances vary least, as not reliable and without
        a mirror image. Without a definition, what `discover` finds.
    """
    if definition is None:
        return discover(positions, labels, pairs())
    markerset = definition
    match = markerset.match(labels)
    own = {name: label for label, name in match.items()}
    segment = {label: markerset.segment[name] for label, name in match.items()}
    extra = [label for label in labels if label not in match]
    if extra:
        segment |= _nearest_segments(labels, pairs(), segment, extra)
    present = set(segment.values())
    return MarkerSet(
        name=markerset.name,
        labels=tuple(labels),
        segment={label: segment[label] for label in labels},
        reliable={label: label in match and markerset.reliable[match[label]] for label in labels},
        mirror={
            label: own[markerset.mirror[name]]
            for label, name in match.items()
            if markerset.mirror.get(name) in own
        },
        root_segments=tuple(s for s in markerset.root_segments if s in present),
        title=markerset.title,
        source=markerset.source,
        joints={
            joint: cast(Joint, tuple(tuple(own[name] for name in point) for point in points))
            for joint, points in markerset.joints.items()
            if all(name in own for point in points for name in point)
        },
    )


def _nearest_segments(
    labels: Sequence[str],
    pairs: PairStatistics,
    segment: Mapping[str, str],
    extra: Sequence[str],
) -> dict[str, str]:
    """Return a segment for each extra marker; its own label where none was seen with it."""
    spread = pairs.of_common(MIN_COMMON)[1]
    index = {label: m for m, label in enumerate(labels)}
    members: dict[str, list[int]] = {}
    for label, name in segment.items():
        members.setdefault(name, []).append(index[label])
    result = {}
    for label in extra:
        mean = {name: float(spread[index[label], group].mean()) for name, group in members.items()}
        name = min(mean, key=lambda key: mean[key])
        result[label] = name if np.isfinite(mean[name]) else label
    return result

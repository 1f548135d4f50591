"""The marker set of a clip: from a definition, from its data, or both."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.geometry.distances import PairStatistics, pair_statistics
from priorfill.geometry.neighbourhoods import MAX_DENSE_MARKERS
from priorfill.geometry.rigid_groups import MIN_COMMON
from priorfill.markers.definitions import recognise
from priorfill.markers.discover import discover
from priorfill.markers.marker_set import Joint, MarkerSet

__all__ = ["describe", "describe_markers"]


def describe(clip: Clip, definition: MarkerSet | None = None) -> MarkerSet:
    """Return the marker set of a clip, with exactly the clip's markers and labels.

    Parameters
    ----------
    clip : Clip
        The clip.
    definition : MarkerSet, optional
        Definition to use; by default the one that fits the labels, if any.

    Returns
    -------
    MarkerSet
        See `describe_markers`.

    Raises
    ------
    MarkerSetError
        If a definition file is malformed.

    See Also
    --------
    discover : Finds a marker set from the data alone.

    Examples
    --------
    >>> clip = Clip(np.zeros((2, 2, 3)), ("LKNE", "RKNE"), rate=100.0)
    >>> describe(clip).name
    'discovered'
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
    """Return the marker set of some markers, from a definition, from their motion, or both.

    Parameters
    ----------
    labels : sequence of str
        The markers.
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    definition : MarkerSet or None
        Definition to use; None to find the marker set from the data.
    pairs : callable
        Returns the statistics of the markers' distances; called only if needed.

    Returns
    -------
    MarkerSet
        The definition, restricted to the markers given. Markers it does not contain are assigned to
        the segment to which their distances vary least, as not reliable and without a mirror image;
        among more than `MAX_DENSE_MARKERS` markers, each to a segment of its own.
        Without a definition, the result of `discover`.

    See Also
    --------
    describe : The same for a clip.
    discover : Used where there is no definition.
    """
    many = len(labels) > MAX_DENSE_MARKERS
    if definition is None:
        return discover(positions, labels, None if many else pairs())
    match = definition.match(labels)
    own = {name: label for label, name in match.items()}
    segment = {label: definition.segment[name] for label, name in match.items()}
    extra = [label for label in labels if label not in match]
    if extra and many:
        segment |= {label: label for label in extra}
    elif extra:
        segment |= _nearest_segments(labels, pairs(), segment, extra)
    present = set(segment.values())
    return MarkerSet(
        name=definition.name,
        labels=tuple(labels),
        segment={label: segment[label] for label in labels},
        reliable={label: label in match and definition.reliable[match[label]] for label in labels},
        mirror={
            label: own[definition.mirror[name]]
            for label, name in match.items()
            if definition.mirror.get(name) in own
        },
        root_segments=tuple(s for s in definition.root_segments if s in present),
        title=definition.title,
        source=definition.source,
        joints={
            joint: cast(Joint, tuple(tuple(own[name] for name in point) for point in points))
            for joint, points in definition.joints.items()
            if all(name in own for point in points for name in point)
        },
    )


def _nearest_segments(
    labels: Sequence[str],
    pairs: PairStatistics,
    segment: Mapping[str, str],
    extra: Sequence[str],
) -> dict[str, str]:
    """Return a segment for each extra marker: its own label if it was seen with no other marker."""
    spread = pairs.of_common(MIN_COMMON)[1]
    index = {label: m for m, label in enumerate(labels)}
    markers_of: dict[str, list[int]] = {}
    for label, name in segment.items():
        markers_of.setdefault(name, []).append(index[label])
    result = {}
    for label in extra:
        mean = {
            name: float(spread[index[label], group].mean()) for name, group in markers_of.items()
        }
        name = min(mean, key=lambda key: mean[key])
        result[label] = name if np.isfinite(mean[name]) else label
    return result

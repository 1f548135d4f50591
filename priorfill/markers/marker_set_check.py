"""Whether a marker set fits a clip: its labels, and the body that carries them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import MarkerSetError
from priorfill.markers.definitions import recognise
from priorfill.markers.marker_set import MarkerSet

__all__ = ["check_marker_set"]

MAX_RIGID_SPREAD = 30.0
"""mm. Standard deviation of a distance within a segment that soft tissue does not reach."""

MAX_LOOSE_SHARE = 0.15
"""Share of the distances within segments that may vary more. With the right labels it is at most
0.04 in 27 recordings of gait, CMU and HDM05, and with permuted labels at least 0.28."""

MIN_DISTANCES = 8
"""Distances within segments needed for a decision."""

MIN_CLIP_SHARE = 0.4
"""Share of the clip's markers that a given set contains without a note."""

MAX_POSES = 60
"""Poses, evenly spaced, in which distances are measured."""


def check_marker_set(
    labels: Sequence[str],
    positions: NDArray[np.float64],
    definition: MarkerSet | None,
    *,
    given: bool,
) -> tuple[str, ...]:
    """Return notes on a marker set that fits a clip poorly.

    Parameters
    ----------
    labels : sequence of str
        The clip's labels.
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    definition : MarkerSet or None
        The marker set; without one there is nothing to check.
    given : bool
        Whether the user chose it. Otherwise it was recognised by the labels.

    Raises
    ------
    MarkerSetError
        If a set that the user chose contains none of the markers.
    """
    if definition is None:
        return ()
    match = definition.match(labels)
    notes = []
    if given and len(match) < MIN_CLIP_SHARE * len(labels):
        better = recognise(labels)
        advice = "leave it out, to find the segments from the data"
        if better is not None and len(better.match(labels)) > len(match):
            advice = f"{better.name} has {len(better.match(labels))} of them"
        if not match:
            raise MarkerSetError(
                f"marker set {definition.name} has none of the clip's {len(labels)} markers "
                f"({', '.join(labels[:6])}{', ...' if len(labels) > 6 else ''}); {advice}"
            )
        notes.append(
            f"marker set {definition.name} has only {len(match)} of the clip's {len(labels)} "
            f"markers; {advice}"
        )
    loose, count = _loose_distances(labels, positions, definition, match)
    if count >= MIN_DISTANCES and loose > MAX_LOOSE_SHARE * count:
        notes.append(
            f"marker set {definition.name} does not fit the body: {loose} of {count} distances "
            f"within its segments vary by more than {MAX_RIGID_SPREAD:.0f} mm; the labels may be "
            "in the wrong order, or of another marker set"
        )
    return tuple(notes)


def _loose_distances(
    labels: Sequence[str],
    positions: NDArray[np.float64],
    definition: MarkerSet,
    match: dict[str, str],
) -> tuple[int, int]:
    """Return how many distances within segments vary too much, and how many are known."""
    place = {label: marker for marker, label in enumerate(labels)}
    segments: dict[str, list[int]] = {}
    for label, name in match.items():
        segments.setdefault(definition.segment[name], []).append(place[label])
    frames = np.unique(np.linspace(0, len(positions) - 1, MAX_POSES).astype(np.intp))
    loose = count = 0
    for markers in segments.values():
        first, second = np.triu_indices(len(markers), 1)
        part = positions[frames][:, markers]
        distance = np.sqrt(((part[:, first] - part[:, second]) ** 2).sum(axis=2))
        known = ~np.isnan(distance)
        enough = known.sum(axis=0) > 1
        values = np.where(known, distance, 0.0)[:, enough]
        divisor = known[:, enough].sum(axis=0)
        variance = (values**2).sum(axis=0) / divisor - (values.sum(axis=0) / divisor) ** 2
        loose += int((np.sqrt(np.maximum(variance, 0.0)) > MAX_RIGID_SPREAD).sum())
        count += int(enough.sum())
    return loose, count

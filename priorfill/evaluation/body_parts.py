"""The markers of a clip by segment and by limb."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from priorfill.clip import Clip
from priorfill.geometry.distances import pair_distances
from priorfill.markers.describe import describe
from priorfill.markers.marker_set import MarkerSet

__all__ = ["FEET", "LIMBS", "MIN_LIMB_MARKERS", "SIDES", "BodyParts", "parts_of"]

LIMBS = {
    "leg": ("thigh", "shank", "foot", "hindfoot", "forefoot", "hallux"),
    "arm": ("upper_arm", "forearm", "hand"),
}
"""Segments of each limb, without the side."""

SIDES = ("left", "right")
"""Prefixes of the names of a limb's segments."""

FEET = ("foot", "hindfoot", "forefoot", "hallux")
"""Segments that touch the floor."""

MIN_LIMB_MARKERS = 4
"""Markers of a limb at least. Where segments are found from the data, a limb is extended by the
nearest segments until it has as many."""


@dataclass(frozen=True, eq=False)
class BodyParts:
    """The markers of a clip by segment and by limb.

    Attributes
    ----------
    segments, limbs : list of list of int
        Markers of each segment with more than one marker, and of each limb.
    segment_of : dict of str to str
        Each marker's segment.
    limb_names : list of str
        Name of each limb, such as ``left_leg``; where segments were found from the data, that of
        the segment that it was grown from.
    known : bool
        Whether the limbs are those of a marker set.
    """

    segments: list[list[int]]
    limbs: list[list[int]]
    segment_of: dict[str, str]
    limb_names: list[str]
    known: bool


def parts_of(clip: Clip, marker_set: MarkerSet | None = None) -> BodyParts:
    """Return the segments and limbs of a clip, by its marker set or found from the data.

    Parameters
    ----------
    clip : Clip
        The clip.
    marker_set : MarkerSet, optional
        Its marker set; recognised by the labels if not given.

    Returns
    -------
    BodyParts
        Segments and limbs.
    """
    described = describe(clip, marker_set)
    segment_of = {label: described.segment.get(label, "") for label in clip.labels}
    by_name: dict[str, list[int]] = {}
    for i, label in enumerate(clip.labels):
        if segment_of[label]:
            by_name.setdefault(segment_of[label], []).append(i)
    limbs = {
        f"{side}_{limb}": [i for name in names for i in by_name.get(f"{side}_{name}", [])]
        for limb, names in LIMBS.items()
        for side in SIDES
    }
    limbs = {name: limb for name, limb in limbs.items() if len(limb) >= MIN_LIMB_MARKERS}
    known = bool(limbs)
    if not known:
        limbs = dict(zip(by_name, _grown(clip, list(by_name.values())), strict=True))
    segments = [some for some in by_name.values() if len(some) > 1]
    return BodyParts(segments, list(limbs.values()), segment_of, list(limbs), known)


def _grown(clip: Clip, segments: list[list[int]]) -> list[list[int]]:
    """Extend each segment by the nearest ones until it has the markers of a limb."""
    distance, _ = pair_distances(clip.positions)
    limbs = []
    for segment in segments:
        apart = [float(distance[np.ix_(segment, other)].mean()) for other in segments]
        limb = list(segment)
        for _, other in sorted(zip(apart, segments, strict=True), key=lambda pair: pair[0]):
            if len(limb) >= MIN_LIMB_MARKERS:
                break
            limb += [i for i in other if i not in limb]
        limbs.append(limb)
    return limbs

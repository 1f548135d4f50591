"""Marker sets: on which segment each marker sits, and which are fit for the search.

A set comes from a definition file (``database/markersets/README.md`` describes its form), or,
for a clip that fits none, from the clip's own data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

__all__ = ["DISCOVERED", "MarkerSet", "same_markers"]

DISCOVERED = "discovered"
"""Name of a set that was found from the data."""


Joint = tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]
"""Markers of three points, the middle one at the joint."""


@dataclass(frozen=True)
class MarkerSet:
    """What is known of a set of markers.

    Attributes
    ----------
    name : str
        How the set is called; `DISCOVERED` if it was found from the data.
    labels : tuple of str
        The markers.
    segment : dict of str to str
        The body segment of each marker.
    reliable : dict of str to bool
        Which markers are placed the same way on everybody and so are fit for the search.
    mirror : dict of str to str
        The mirror image of each marker that has one; a marker in the middle is its own.
    root_segments : tuple of str
        Segments that can carry the root frame, best first.
    title : str
        One line on what the set is.
    source : str
        Where the definition is from.
    aliases : dict of str to str
        Other spellings and the labels they stand for.
    optional : frozenset of str
        Markers that a clip of this set need not have.
    joints : dict of str to three tuples of str
        Angles to compare fills by: the markers whose mean is the first point, the joint, and the
        last point.
    """

    name: str
    labels: tuple[str, ...]
    segment: dict[str, str]
    reliable: dict[str, bool]
    mirror: dict[str, str]
    root_segments: tuple[str, ...]
    title: str = ""
    source: str = ""
    aliases: dict[str, str] = field(default_factory=dict)
    optional: frozenset[str] = frozenset()
    joints: dict[str, Joint] = field(default_factory=dict)

    @property
    def segments(self) -> dict[str, tuple[str, ...]]:
        """The markers of each segment, in the order of `labels`."""
        result: dict[str, list[str]] = {}
        for label in self.labels:
            result.setdefault(self.segment[label], []).append(label)
        return {segment: tuple(labels) for segment, labels in result.items()}

    def match(self, labels: Sequence[str]) -> dict[str, str]:
        """Return which of `labels` this set knows, and as which of its markers.

        Upper and lower case are the same; an alias counts only where the marker is not there
        under its own label. No marker of the set is given twice.
        """
        known = {label.upper(): label for label in self.labels}
        result: dict[str, str] = {}
        taken: set[str] = set()
        other = {alias.upper(): label for alias, label in self.aliases.items()}
        for names in (known, other):
            for label in labels:
                name = names.get(label.upper())
                if name is not None and label not in result and name not in taken:
                    result[label] = name
                    taken.add(name)
        return {label: result[label] for label in labels if label in result}


def same_markers(
    labels: Sequence[str], others: Sequence[str], marker_set: MarkerSet | None
) -> tuple[list[int], list[int]]:
    """Find which markers of two recordings are the same.

    The same label is the same marker; where the marker set knows both, so are upper and lower
    case and the other spellings that it lists.

    Parameters
    ----------
    labels, others : sequence of str
        The markers of the two recordings.
    marker_set : MarkerSet or None
        As defined, with its other spellings.

    Returns
    -------
    here, there : list of int
        Indices into `labels` and `others` of the markers that both have, pair by pair.
    """
    mine, theirs = {label: label for label in labels}, {label: label for label in others}
    if marker_set is not None:
        mine |= marker_set.match(labels)
        theirs |= marker_set.match(others)
    place = {name: others.index(label) for label, name in theirs.items()}
    here = [i for i, label in enumerate(labels) if mine[label] in place]
    return here, [place[mine[labels[i]]] for i in here]

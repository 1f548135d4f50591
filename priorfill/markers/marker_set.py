"""Marker sets: the segment of each marker, and which markers are reliable.

A set is read from a definition file (see ``database/markersets/README.md``) or, if a clip fits
none, found from the clip's own data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

__all__ = ["DISCOVERED", "MarkerSet", "same_markers"]

DISCOVERED = "discovered"
"""Name of sets found from the data."""


Joint = tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]
"""Markers whose means are three points: above the joint, the joint, and below it."""


@dataclass(frozen=True)
class MarkerSet:
    """Segments, reliability and mirror pairs of a set of markers.

    Attributes
    ----------
    name : str
        Name of the set; `DISCOVERED` if it was found from the data.
    labels : tuple of str
        The markers.
    segment : dict of str to str
        The body segment of each marker.
    reliable : dict of str to bool
        Whether a marker is placed alike on all subjects, so that poses can be searched by it.
    mirror : dict of str to str
        The contralateral marker of each marker that has one; a midline marker is its own.
    root_segments : tuple of str
        Segments suited to define the root frame, best first.
    title : str
        One-line description.
    source : str
        Source of the definition.
    aliases : dict of str to str
        Alternative labels, with the label each one stands for.
    optional : frozenset of str
        Markers that a clip of this set may lack.
    joints : dict of str to three tuples of str
        Joint angles that evaluations report: the markers whose means are the point above the
        joint, the joint, and the point below it.

    See Also
    --------
    describe : The marker set of a clip.
    load : Read a definition.

    Examples
    --------
    >>> pelvis = {"LASI": "pelvis", "RASI": "pelvis"}
    >>> mirror = {"LASI": "RASI", "RASI": "LASI"}
    >>> marker_set = MarkerSet(
    ...     "hips", tuple(pelvis), pelvis, dict.fromkeys(pelvis, True), mirror, ("pelvis",)
    ... )
    >>> marker_set.segments
    {'pelvis': ('LASI', 'RASI')}
    >>> marker_set.match(["lasi", "C7"])
    {'lasi': 'LASI'}
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
        """Return which of ``labels`` belong to this set, and to which of its markers.

        Case is ignored. An alias is used only if no label is that of the marker itself. No marker
        of the set is matched twice.

        Parameters
        ----------
        labels : sequence of str
            Labels of a clip.

        Returns
        -------
        dict of str to str
            The set's marker for each known label, in the order of ``labels``.
        """
        by_label = {label.upper(): label for label in self.labels}
        result: dict[str, str] = {}
        taken: set[str] = set()
        by_alias = {alias.upper(): label for alias, label in self.aliases.items()}
        for names in (by_label, by_alias):
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

    Equal labels are the same marker. For markers of the marker set, case is ignored, and its
    aliases count as well.

    Parameters
    ----------
    labels, others : sequence of str
        The markers of the two recordings.
    marker_set : MarkerSet or None
        Definition with aliases.

    Returns
    -------
    here, there : list of int
        Indices into ``labels`` and ``others`` of the common markers, pair by pair.

    Examples
    --------
    >>> same_markers(("LKNE", "LANK"), ("C7", "LANK"), None)
    ([1], [1])
    """
    mine, theirs = {label: label for label in labels}, {label: label for label in others}
    if marker_set is not None:
        mine |= marker_set.match(labels)
        theirs |= marker_set.match(others)
    place = {name: others.index(label) for label, name in theirs.items()}
    here = [i for i, label in enumerate(labels) if mine[label] in place]
    return here, [place[mine[labels[i]]] for i in here]

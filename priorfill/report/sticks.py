"""Which markers the page connects by lines, so that a pose looks like a body."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

from priorfill.report.shown_text import MAX_LABEL, shown

if TYPE_CHECKING:
    from priorfill.filling.result import Result

__all__ = ["sticks_of"]


def sticks_of(result: Result) -> tuple[list[list[int]], list[str], list[str]]:
    """Return the sticks of a result, its segments, and the segment of each marker.

    Parameters
    ----------
    result : Result
        Of a fill.

    Returns
    -------
    sticks : list of [int, int]
        Pairs of markers, of one subject each.
    segments : list of str
        Names of segments.
    segment_of : list of str
        The segment of each marker.
    """
    sticks: list[list[int]] = []
    segment_of: list[str] = []
    for one in result.by_subject:
        offset = len(segment_of)
        place = {label: offset + i for i, label in enumerate(one.clip.labels)}
        for labels in one.marker_set.segments.values():
            members = [place[label] for label in labels if label in place]
            sticks += [[i, j] for i, j in itertools.pairwise(members)]
        segment_of += [
            shown(one.marker_set.segment.get(label, ""), MAX_LABEL) for label in one.clip.labels
        ]
    return sticks, list(dict.fromkeys(name for name in segment_of if name)), segment_of

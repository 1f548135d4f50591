"""Division of gap groups into batches of segments, each predicted by one regression.

Gaps of nearby markers in the same frames are predicted jointly. Frames of a gap, and gaps of the
same markers anywhere in the clip, are predicted by one regression if they lose little by the
visible markers that they do not have in common.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import GapGroup, constant_spans
from priorfill.geometry.clustering import single_linkage
from priorfill.methods.gpr.gap_segments import GapSegment, SegmentBatch
from priorfill.methods.gpr.visible_sets import MergingLimits, VisibleSets, merge_visible_sets
from priorfill.runtime.elementary import exp
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = ["SegmentOptions", "plan_batches", "split_into_batches"]

_Bool = NDArray[np.bool_]
_Float = NDArray[np.float64]


@dataclass(frozen=True)
class SegmentOptions:
    """How gaps are joined and divided.

    Attributes
    ----------
    joint_distance : float
        mm. Markers missing in the same frames are predicted jointly if a chain of them has no
        greater distances: the markers of one limb are, two limbs are not.
    length_scale : float
        mm. A visible marker at the distance D from the missing ones has the importance
        exp(-D² / 2 length_scale²).
    min_weight : float
        Added to the importance of each visible marker.
    max_share : float
        Frames with different visible markers are predicted by one regression if none of them loses
        more than this share of the importance of its visible markers.
    enough_sets : int
        Where a gap has more sets of visible markers than this, `max_forced_share` replaces
        `max_share`: many markers come and go, and each set has a few frames.
    max_forced_share : float
        Share of the importance that frames may lose in such a gap.
    max_length_ratio : float
        Gaps apart from each other are predicted by one regression if the longest is at most this
        many times the shortest: models are weighted by their errors in blocks of that length.
    min_block_seconds : float
        s. Blocks that are held out for shorter segments are this long, or as long as the gap: in
        the middle of a long gap no measured sample is near. Longer ones did not fill better.
    max_gaps : int
        Gaps apart from each other that one regression predicts at most, because the poses next to
        each of them are further training poses.
    """

    joint_distance: float = 350.0
    length_scale: float = 220.0
    min_weight: float = 0.005
    max_share: float = 0.1
    enough_sets: int = 4
    max_forced_share: float = 0.3
    max_length_ratio: float = 2.0
    min_block_seconds: float = 0.3
    max_gaps: int = 16

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "joint_distance", "min_weight", "min_block_seconds")
        check_at_least(self, 1.0, "length_scale", "max_length_ratio", "max_gaps", "enough_sets")
        check_between(self, 0.0, 1.0, "max_share", "max_forced_share")

    @property
    def limits(self) -> MergingLimits:
        """When sets of visible markers are merged."""
        return MergingLimits(self.max_share, self.enough_sets, self.max_forced_share)

    def block_seconds(self, batch: SegmentBatch, rate: float) -> float:
        """Return the length (s) of the blocks that are held out for a batch, at a rate (Hz)."""
        gap, own = batch.gap_frames / rate, batch.frames / rate
        return max(own, min(gap, self.min_block_seconds))

    def weight(self, distance: _Float, markers: NDArray[np.intp]) -> _Float:
        """Return the importance of each marker for some missing ones [shape=(markers,)]."""
        nearest = distance[markers].min(axis=0)
        weight: _Float = exp(-(nearest**2) / (2.0 * self.length_scale**2)) + self.min_weight
        return weight


def split_into_batches(
    group: GapGroup,
    valid: _Bool,
    distance: _Float,
    options: SegmentOptions = SegmentOptions(),
) -> list[SegmentBatch]:
    """Divide a gap group into batches of segments.

    Parameters
    ----------
    group : GapGroup
        The missing samples.
    valid : ndarray of bool [shape=(frames, markers)]
        Which samples of the clip are measured.
    distance : ndarray [shape=(markers, markers), mm]
        Rms distance of each pair of markers; infinite where unknown.
    options : SegmentOptions
        When gaps are joined and divided.

    Returns
    -------
    list of SegmentBatch
        Every missing sample of the group in exactly one of their segments.

    See Also
    --------
    plan_batches : Joins those of all groups.
    """
    batches = []
    for markers, start, stop in _joint_gaps(group, distance, options):
        shown = valid[start:stop].copy()
        shown[:, markers] = False
        edges = constant_spans(shown)
        sets = VisibleSets.of(shown[[a for a, _ in edges]])
        merged = merge_visible_sets(sets, options.weight(distance, markers), options.limits)
        for visible, spans in zip(merged.visible, merged.spans, strict=True):
            some = np.flatnonzero(visible)
            segments = [
                GapSegment(markers, start + a, start + b, some, stop - start)
                for a, b in _runs(edges, spans)
            ]
            batches.append(SegmentBatch(tuple(segments)))
    return batches


def plan_batches(
    groups: Sequence[GapGroup],
    valid: _Bool,
    distance: _Float,
    options: SegmentOptions = SegmentOptions(),
) -> list[SegmentBatch]:
    """Divide all gap groups into batches; parameters as of `split_into_batches`.

    Segments of several gaps are one batch if the same markers are missing for about as long.
    """
    together: dict[bytes, list[SegmentBatch]] = {}
    for group in groups:
        for batch in split_into_batches(group, valid, distance, options):
            together.setdefault(batch.markers.tobytes(), []).append(batch)
    return [
        batch
        for some in together.values()
        for alike in _of_similar_length(some, options)
        for batch in _shared(alike, distance, options)
    ]


def _joint_gaps(
    group: GapGroup, distance: _Float, options: SegmentOptions
) -> list[tuple[NDArray[np.intp], int, int]]:
    """Return markers, start and stop of gaps that are predicted jointly."""
    together: dict[tuple[int, int], list[int]] = {}
    for gap in group.gaps:
        together.setdefault((gap.start, gap.stop), []).append(gap.marker)
    joint = []
    for (start, stop), markers in together.items():
        chosen = np.array(markers, dtype=np.intp)
        # the distance of markers that are never visible together is infinite: they are separated
        limbs = single_linkage(distance[np.ix_(chosen, chosen)], options.joint_distance)
        joint += [(chosen[limb], start, stop) for limb in limbs]
    return joint


def _runs(edges: Sequence[tuple[int, int]], spans: Sequence[int]) -> list[tuple[int, int]]:
    """Return the frames of some spans, those that follow one another as one run."""
    ordered = sorted(spans)
    breaks = [0, *(i + 1 for i, (a, b) in enumerate(pairwise(ordered)) if b != a + 1)]
    return [
        (edges[ordered[a]][0], edges[ordered[b - 1]][1])
        for a, b in pairwise([*breaks, len(ordered)])
    ]


def _of_similar_length(
    batches: Sequence[SegmentBatch], options: SegmentOptions
) -> list[list[SegmentBatch]]:
    """Group batches by their length; those with too few visible markers stay alone."""
    alike = [[batch] for batch in batches if not batch.has_enough_visible]
    shortest = 0.0
    seen = [batch for batch in batches if batch.has_enough_visible]
    for batch in sorted(seen, key=lambda batch: batch.frames):
        if batch.frames > options.max_length_ratio * shortest:
            shortest = batch.frames
            alike.append([])
        alike[-1].append(batch)
    return alike


def _shared(
    batches: Sequence[SegmentBatch], distance: _Float, options: SegmentOptions
) -> list[SegmentBatch]:
    """Join batches of the same markers that lose little by it."""
    if len(batches) == 1:
        return list(batches)
    batches = sorted(batches, key=lambda batch: batch.segments[0].start)
    visible = np.zeros((len(batches), len(distance)), dtype=bool)
    for number, batch in enumerate(batches):
        visible[number, batch.visible] = True
    weight = options.weight(distance, batches[0].markers)
    # no more of it in one gap, whose batches would touch each other
    limits = replace(options.limits, max_forced_share=options.max_share)
    merged = merge_visible_sets(VisibleSets.of(visible), weight, limits)
    shared = []
    for common, own in zip(merged.visible, merged.spans, strict=True):
        parts: list[list[GapSegment]] = [[]]
        for index in sorted(own):
            segments = batches[index].segments
            if parts[-1] and len(parts[-1]) + len(segments) > options.max_gaps:
                parts.append([])
            parts[-1] += [replace(one, visible=np.flatnonzero(common)) for one in segments]
        shared += [SegmentBatch(tuple(part)) for part in parts]
    return shared

"""Gap segments: the missing samples that are predicted together.

Gaps of nearby markers in the same frames are predicted jointly. A gap during which the set of
visible markers changes is divided in time, but only where a segment would otherwise lose visible
markers that are important for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import GapGroup, constant_spans
from priorfill.geometry.clustering import single_linkage
from priorfill.runtime.elementary import exp
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = ["GapSegment", "SegmentOptions", "split_into_segments"]

MIN_VISIBLE = 3
"""Visible markers needed: three points define a frame of reference."""


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
    max_loss : float
        Adjacent segments are joined if neither loses more than this share of the importance of its
        visible markers.
    max_segments : int
        Where a gap has more segments than this, `max_forced_loss` replaces `max_loss`.
    max_forced_loss : float
        Largest share of the importance that joining adjacent segments may lose in such a gap.
    """

    joint_distance: float = 350.0
    length_scale: float = 220.0
    min_weight: float = 0.005
    max_loss: float = 0.1
    max_segments: int = 8
    max_forced_loss: float = 0.5

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "joint_distance", "min_weight")
        check_at_least(self, 1.0, "length_scale", "max_segments")
        check_between(self, 0.0, 1.0, "max_loss", "max_forced_loss")


@dataclass(frozen=True, eq=False)
class GapSegment:
    """Markers missing together in frames ``start <= frame < stop``, and the visible ones.

    Attributes
    ----------
    markers : ndarray of int [shape=(missing markers,)]
        Missing in all of these frames.
    start, stop : int
        Frames of the clip.
    visible : ndarray of int [shape=(visible markers,)]
        Measured in all of these frames.
    """

    markers: NDArray[np.intp]
    start: int
    stop: int
    visible: NDArray[np.intp]

    @property
    def has_enough_visible(self) -> bool:
        """Whether the visible markers define a frame of reference."""
        return len(self.visible) >= MIN_VISIBLE

    def with_margin(
        self, valid: NDArray[np.bool_], visible: NDArray[np.intp], margin: int
    ) -> NDArray[np.intp]:
        """Return its frames and adjacent ones in which some markers are measured.

        Parameters
        ----------
        valid : ndarray of bool [shape=(frames, markers)]
            Which samples of the clip are measured.
        visible : ndarray of int
            The markers that must be measured.
        margin : int
            Maximum number of adjacent frames on either side.
        """
        first, last = self.start, self.stop
        while first > max(0, self.start - margin) and valid[first - 1, visible].all():
            first -= 1
        while last < min(len(valid), self.stop + margin) and valid[last, visible].all():
            last += 1
        return np.arange(first, last)


def split_into_segments(
    group: GapGroup,
    valid: NDArray[np.bool_],
    distance: NDArray[np.float64],
    options: SegmentOptions = SegmentOptions(),
) -> list[GapSegment]:
    """Divide a gap group into segments.

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
    list of GapSegment
        Every missing sample of the group in exactly one of them, in order of time.

    See Also
    --------
    priorfill.methods.gpr.predict.SegmentPredictor : Predicts the segments.
    """
    segments = []
    for markers, start, stop in _joint_gaps(group, distance, options):
        shown = valid[start:stop].copy()
        shown[:, markers] = False
        nearest = distance[markers].min(axis=0)
        weight = exp(-(nearest**2) / (2.0 * options.length_scale**2)) + options.min_weight
        spans = [(a, b, shown[a]) for a, b in constant_spans(shown)]
        while len(spans) > 1:
            losses = [_loss(weight, one, other) for (_, _, one), (_, _, other) in pairwise(spans)]
            best = int(np.argmin(losses))
            few = len(spans) <= options.max_segments
            if losses[best] > (options.max_loss if few else options.max_forced_loss):
                break
            (a, _, one), (_, b, other) = spans[best], spans[best + 1]
            spans[best : best + 2] = [(a, b, one & other)]
        segments += [
            GapSegment(markers, start + a, start + b, np.flatnonzero(visible))
            for a, b, visible in spans
        ]
    return sorted(segments, key=lambda segment: (segment.start, segment.markers[0]))


def _joint_gaps(
    group: GapGroup, distance: NDArray[np.float64], options: SegmentOptions
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


def _loss(weight: NDArray[np.float64], one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    """Return the share of the visible markers' weight that joining two spans would lose."""
    both = one & other
    if both.sum() < MIN_VISIBLE <= max(one.sum(), other.sum()):
        return 1.0
    larger = max(weight[one].sum(), weight[other].sum())
    return float(1.0 - weight[both].sum() / larger) if larger > 0 else 0.0

"""Spikes: a marker leaves its path for at most a tenth of a second, and returns."""

from __future__ import annotations

import numpy as np

from priorfill.artefacts.marker_path import (
    MarkerPath,
    PathSegment,
    SuspectSpan,
    TypicalDistances,
    thinned,
)

__all__ = ["find_spikes"]


def find_spikes(path: MarkerPath, segments: list[PathSegment]) -> list[SuspectSpan]:
    """Find short segments between breaks that are spikes.

    Parameters
    ----------
    path : MarkerPath
    segments : list of PathSegment
        The whole path, cut at every break and gap.

    Returns
    -------
    list of SuspectSpan
        In order of time; adjacent short segments are one spike.

    See Also
    --------
    outlier_runs : Adds the longer segments.
    """
    max_frames = path.spike_frames
    if not any(segment.broken and segment.frames <= max_frames for segment in segments):
        return []
    sample = path.distances_in(thinned(0, len(path.positions)))
    typical = TypicalDistances.of(sample, path.options.min_spread)
    spikes = []
    start = -1
    open_end, largest_break = False, 0.0
    for i, segment in enumerate(segments):
        if segment.frames > max_frames or not segment.broken:
            continue
        if start < 0:
            start = segment.start
            open_end, largest_break = not segment.break_before, 0.0
        largest_break = max(largest_break, segment.break_before, segment.break_after)
        if segment.break_after and segments[i + 1].frames <= max_frames:
            continue
        open_end |= not segment.break_after
        if _is_spike(path, typical, start, segment.stop, open_end, largest_break):
            spikes.append(SuspectSpan(start, segment.stop, True))
        start = -1
    return spikes


def _is_spike(
    path: MarkerPath,
    typical: TypicalDistances,
    start: int,
    stop: int,
    open_end: bool,
    largest_break: float,
) -> bool:
    """Return whether the frames between two breaks, or a break and a gap, are a spike."""
    if largest_break < path.options.min_long_break:
        # a small break next to a gap may be the turning point of a hit
        if open_end:
            return False
        if stop - start == 1 and not _is_off_both_lines(path, start):
            return False
    return (
        open_end or _returns(path, start, stop) or _has_unusual_distance(path, typical, start, stop)
    )


def _is_off_both_lines(path: MarkerPath, frame: int) -> bool:
    """Return whether neither the path before a frame nor the one after leads to it.

    Where a path turns within a frame, as in a hit, both lead to the turning point.
    """
    for near, far in ((frame - 1, frame - 2), (frame + 1, frame + 2)):
        if far < 0 or far >= len(path.positions):
            continue
        points = path.relative(np.array([frame, near, far], dtype=np.intp))
        miss = np.linalg.norm(points[0] - 2.0 * points[1] + points[2])
        if miss < path.options.min_kink:
            return False
    return True


def _returns(path: MarkerPath, start: int, stop: int) -> bool:
    """Return whether the path continues after some frames near where it was before them."""
    points = path.relative(slice(start - 1, stop + 1))
    fraction = np.linspace(0.0, 1.0, len(points))[:, None]
    offset = points - (1 - fraction) * points[0] - fraction * points[-1]
    excursion = np.linalg.norm(offset, axis=1).max()
    return bool(excursion > np.linalg.norm(points[-1] - points[0]))


def _has_unusual_distance(
    path: MarkerPath, typical: TypicalDistances, start: int, stop: int
) -> bool:
    """Return whether a distance is unusual in some frames, but neither before nor after them."""
    deviation = np.nan_to_num(
        np.abs(path.distances_in(slice(start - 1, stop + 1)) - typical.median)
    )
    inside = deviation[1:-1].max(axis=0)
    outside = np.maximum(deviation[0], deviation[-1])
    factor = path.options.min_spike_deviation
    return bool(((inside > factor * typical.spread) & (inside > factor * outside)).any())

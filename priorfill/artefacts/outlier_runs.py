"""Outlier runs: parts of a marker's path that are not the marker, such as ghosts or wrong labels.

The path is cut into segments where it breaks and where the marker is missing. Short segments
between breaks are spikes (`priorfill.artefacts.spikes`). The longer ones are compared with the main
segment, the one whose distances from the reference markers agree best with the rest of the path.
Of the two sides of a break, the one with the more unusual distances is the wrong one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.marker_path import (
    MarkerPath,
    OutlierRunOptions,
    PathSegment,
    SuspectSpan,
    TypicalDistances,
    cut_path,
    known_medians,
    medians_of_parts,
    thinned,
)
from priorfill.artefacts.spikes import find_spikes
from priorfill.gaps import runs

__all__ = ["OutlierRun", "is_wrong_side", "outlier_runs"]


@dataclass(frozen=True)
class OutlierRun:
    """A part of a marker's path in which it is somewhere else.

    Attributes
    ----------
    marker, start, stop : int
        The marker, and frames ``start <= frame < stop``.
    spike : bool
        Whether it is short.
    size : float
        mm. Size of the largest break in it or at its ends.
    reference : int
        The reference marker with the most unusual distance; the marker itself where there is none.
    distance, typical_distance, spread : float
        mm. The distance from it there, its median elsewhere, and the standard deviation of the
        latter; NaN if unknown.
    """

    marker: int
    start: int
    stop: int
    spike: bool
    size: float
    reference: int
    distance: float = math.nan
    typical_distance: float = math.nan
    spread: float = math.nan


def outlier_runs(
    path: MarkerPath, size: NDArray[np.float64], far: NDArray[np.bool_] | None
) -> list[OutlierRun]:
    """Find the parts of a marker's path in which it is somewhere else.

    Parameters
    ----------
    path : MarkerPath
    size : ndarray [shape=(frames - 1,), mm]
        Sizes of the breaks of the path; 0 where there is none.
    far : ndarray of bool [shape=(frames,)] or None
        Where the marker is too far from its reference markers; see
        `priorfill.artefacts.distance_outliers`.

    Returns
    -------
    list of OutlierRun
        In order of time, disjoint.

    See Also
    --------
    priorfill.artefacts.find_artefacts : Calls all detectors.
    find_spikes : The short ones.
    """
    seen = ~np.isnan(path.positions[:, path.marker, 0])
    segments = cut_path(seen, size)
    if len(segments) < 2 and far is None:
        return []
    spans = find_spikes(path, segments)
    # the path continues across spikes, and across breaks too small for another marker
    taken = np.zeros(len(seen), dtype=bool)
    large = np.where(size >= path.options.min_long_break, size, 0.0)
    for span in spans:
        taken[span.start : span.stop] = True
        large[max(span.start - 1, 0) : span.stop] = 0.0
    if not np.array_equal(large, size):
        segments = cut_path(seen, large)
    spans += _long_spans(path, segments, taken)
    if far is not None:
        spans += [
            SuspectSpan(start, stop, stop - start <= path.spike_frames) for start, stop in runs(far)
        ]
    if not spans:
        return []
    spans = _merged(spans)
    for span in spans:
        taken[span.start : span.stop] = True
    typical = TypicalDistances.of(path.distance[~taken], 0.0)
    spans = _merged(_extended(path, typical, taken, spans))
    return [_describe(path, typical, span, size) for span in spans]


def _long_spans(
    path: MarkerPath, segments: list[PathSegment], taken: NDArray[np.bool_]
) -> list[SuspectSpan]:
    """Return segments with unusual distances; ``taken`` are the frames of spikes."""
    if not segments:
        return []
    long = np.array([segment.frames > path.spike_frames for segment in segments], dtype=bool)
    longest = max(segment.frames for segment in segments)
    gaps_only = not any(segment.broken for segment in segments)
    if long.sum() < 2 or (gaps_only and longest <= path.options.min_main_seconds * path.rate):
        return []
    frames = [thinned(segment.start, segment.stop) for segment in segments]
    lengths = np.array([len(some) for some in frames])
    distance = _without_spikes(path, np.concatenate(frames), taken)
    low, high = (bound.reduce(distance, axis=0) for bound in (np.fmin, np.fmax))
    if gaps_only and not (high - low > path.options.min_gap_distance).any():
        return []  # no deviation is as large
    main, typical = _main_segment(segments, long, distance, lengths, path.options)
    size = medians_of_parts(np.abs(distance - typical.median), lengths)
    return [
        SuspectSpan(segment.start, segment.stop, segment.frames <= path.spike_frames)
        for segment, deviation in zip(segments, size, strict=True)
        if segment is not main
        and _is_unusual(segment, deviation, main, typical, path)
        and _is_on_wrong_sides(path, segment, typical, taken)
    ]


def _without_spikes(
    path: MarkerPath, frames: NDArray[np.intp], taken: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return distances in some frames [shape=(frames, references), mm]; NaN in spikes."""
    return np.where(taken[frames, None], np.nan, path.distances_in(frames))


def _is_unusual(
    segment: PathSegment,
    deviation: NDArray[np.float64],
    main: PathSegment,
    typical: TypicalDistances,
    path: MarkerPath,
) -> bool:
    """Return whether the distances in a segment differ from those of the main segment.

    ``deviation`` is the median deviation of each distance [shape=(references,), mm].
    """
    options = path.options
    if not segment.broken and main.frames <= options.min_main_seconds * path.rate:
        return False
    ratio, size = _confirmed_deviation(deviation, typical.spread, options.min_references)
    if segment.broken:
        return ratio > options.min_deviation
    return ratio > options.min_gap_deviation and size > options.min_gap_distance


def _is_on_wrong_sides(
    path: MarkerPath, segment: PathSegment, typical: TypicalDistances, taken: NDArray[np.bool_]
) -> bool:
    """Return whether a segment is on the wrong side of each break at its ends, if any."""
    ends = (
        (segment.break_before, segment.start, 1),
        (segment.break_after, segment.stop, -1),
    )
    compared = path.spike_frames
    for break_size, frame, direction in ends:
        if break_size:
            first = max(frame - compared, 0)
            near = np.arange(first, min(frame + compared, len(taken)))
            distance = _without_spikes(path, near, taken)
            if not is_wrong_side(
                distance, frame - first, direction, compared, typical, path.options
            ):
                return False
    return True


def is_wrong_side(
    distance: NDArray[np.float64],
    frame: int,
    direction: int,
    frames: int,
    typical: TypicalDistances,
    options: OutlierRunOptions,
) -> bool:
    """Return whether one side of a break has the more unusual distances.

    Parameters
    ----------
    distance : ndarray [shape=(all frames, references), mm]
        NaN where unknown.
    frame : int
        The first frame after the break.
    direction : int
        1: assess the side after the break; -1: the side before it.
    frames : int
        Frames compared on either side.
    typical : TypicalDistances
        Of the main segment.
    options : OutlierRunOptions
    """
    sides = slice(frame, frame + frames), slice(max(frame - frames, 0), frame)
    inside, outside = (
        known_medians(np.abs(distance[side] - typical.median)) / typical.spread
        for side in sides[::direction]
    )
    known = ~np.isnan(inside) & ~np.isnan(outside)
    ratio, threshold = options.wrong_side_ratio, 0.5 * options.min_deviation
    votes_for = int((known & (inside > threshold) & (inside > ratio * outside)).sum())
    votes_against = int((known & (outside > threshold) & (outside > ratio * inside)).sum())
    return votes_for >= max(1, min(options.min_references, int(known.sum())), votes_against)


def _main_segment(
    segments: list[PathSegment],
    long: NDArray[np.bool_],
    distance: NDArray[np.float64],
    lengths: NDArray[np.intp],
    options: OutlierRunOptions,
) -> tuple[PathSegment, TypicalDistances]:
    """Return the segment whose distances fit most of the path, and these distances.

    The cost of a candidate includes its own deviations: the distances of a ghost marker vary so
    much that all other segments would agree with them.

    Parameters
    ----------
    segments : list of PathSegment
        All segments.
    long : ndarray of bool [shape=(segments,)]
        Those that count.
    distance : ndarray [shape=(frames, references), mm]
        Distances in some frames of each segment, one segment after the other.
    lengths : ndarray of int [shape=(segments,)]
        How many frames these are.
    options : OutlierRunOptions
    """
    stop = np.cumsum(lengths)
    frames = np.array([segment.frames for segment in segments])
    inside, kept = np.repeat(long, lengths), lengths[long]
    best: tuple[PathSegment, TypicalDistances] | None = None
    least_cost = np.inf
    longest_first = [i for i in np.argsort(-frames, kind="stable").tolist() if long[i]]
    for candidate in longest_first[: options.main_candidates]:
        own = distance[stop[candidate] - lengths[candidate] : stop[candidate]]
        typical = TypicalDistances.of(own, options.min_spread)
        deviation = medians_of_parts(np.abs(distance[inside] - typical.median), kept)
        known = (~np.isnan(deviation)).sum(axis=1)
        mean = np.nansum(deviation, axis=1) / np.maximum(known, 1)
        cost = float(np.cumsum(frames[long] * mean)[-1])
        if best is None or cost < least_cost:
            best, least_cost = (segments[candidate], typical), cost
    assert best is not None
    return best


def _confirmed_deviation(
    size: NDArray[np.float64], spread: NDArray[np.float64], min_references: int
) -> tuple[float, float]:
    """Return the deviation, in spreads and in mm, that enough reference markers reach."""
    ratio = (size / spread).tolist()
    known = sorted(
        (i for i, one in enumerate(ratio) if not math.isnan(one)), key=lambda i: -ratio[i]
    )
    if not known:
        return 0.0, 0.0
    decisive = known[min(min_references, len(known)) - 1]
    return ratio[decisive], float(size[decisive])


def _merged(spans: Sequence[SuspectSpan]) -> list[SuspectSpan]:
    """Merge spans that touch or overlap; the result is in order of time."""
    merged: list[SuspectSpan] = []
    for span in sorted(spans):
        if merged and merged[-1].stop >= span.start:
            last = merged[-1]
            merged[-1] = SuspectSpan(
                last.start, max(last.stop, span.stop), last.spike and span.spike
            )
        else:
            merged.append(span)
    return merged


def _extended(
    path: MarkerPath,
    typical: TypicalDistances,
    taken: NDArray[np.bool_],
    spans: Sequence[SuspectSpan],
) -> list[SuspectSpan]:
    """Extend spans by the frames around them in which a rigid distance leaves and returns.

    Only if that takes no longer than a spike; otherwise it is a posture.
    """
    options, frames = path.options, path.spike_frames
    rigid = typical.spread < options.max_rigid_spread
    if not rigid.any():
        return list(spans)
    deviation = np.abs(path.distance[:, rigid] - typical.median[rigid])
    ratio = np.nan_to_num(deviation / options.min_spread)
    extended = []
    for span in spans:
        column = ratio[span.start : span.stop].max(axis=0).argmax()
        unusual = (ratio[:, column] > options.min_spike_deviation) & ~taken
        earlier = unusual[max(span.start - frames, 0) : span.start][::-1]
        later = unusual[span.stop : span.stop + frames]
        before, after = (0 if part.all() else int(part.argmin()) for part in (earlier, later))
        extended.append(replace(span, start=span.start - before, stop=span.stop + after))
    return extended


def _describe(
    path: MarkerPath, typical: TypicalDistances, span: SuspectSpan, size: NDArray[np.float64]
) -> OutlierRun:
    """Describe a span by its most unusual distance."""
    largest_break = float(size[max(span.start - 1, 0) : span.stop].max(initial=0.0))
    run = OutlierRun(path.marker, span.start, span.stop, span.spike, largest_break, path.marker)
    inside = path.distance[span.start : span.stop]
    spread = np.fmax(path.options.min_spread, typical.spread)
    ratio = np.nan_to_num(np.abs(inside - typical.median) / spread)
    if not (ratio > path.options.min_evidence_deviation).any():
        return run
    # the peak of a spike, but the median of a longer run
    column = int((ratio.max(axis=0) if span.spike else known_medians(ratio)).argmax())
    if span.spike:
        distance = inside[ratio[:, column].argmax(), column]
    else:
        distance = known_medians(inside[:, column : column + 1])[0]
    return replace(
        run,
        reference=int(path.references[column]),
        distance=float(distance),
        typical_distance=float(typical.median[column]),
        spread=float(typical.spread[column]),
    )

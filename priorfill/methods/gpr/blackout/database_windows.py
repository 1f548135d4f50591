"""Windows of the database whose edges are similar to those of a blackout."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import evenly_spaced
from priorfill.geometry.root_frames import RootGroup
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.blackout.windows import WindowSource
from priorfill.methods.gpr.gap_segments import MIN_VISIBLE
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.task import Task, take_names
from priorfill.search.bank import PoseBank

__all__ = ["similar_windows"]

SPLINE_MARGIN = 3
"""Frames read on either side of a span, for the spline that resamples it to the clip's rate."""


@dataclass(frozen=True)
class _Span:
    """Frames of a pose bank to be read, counted from the one before the blackout.

    Attributes
    ----------
    edges : tuple of (int, int)
        For each visible edge, the frame of the clip and the frame of the span.
    length : float
        From the frame before the blackout to the one after it.
    first, last : int
        First and last frame to be read.
    rate : float
        Of the bank's recording, Hz.
    """

    edges: tuple[tuple[int, int], ...]
    length: float
    first: int
    last: int
    rate: float

    @classmethod
    def of(
        cls, start: int, stop: int, frames: int, rate: float, bank_rate: float, edge_seconds: float
    ) -> _Span:
        """Return the span for a blackout of a clip of some length (frames) and rate (Hz)."""
        margin = int(np.ceil((edge_seconds * rate + 2) / rate * bank_rate)) + SPLINE_MARGIN
        length = (stop - start + 1) / rate * bank_rate
        edges = ((start - 1, 0), (stop, round(length)))
        return cls(
            tuple((frame, at) for frame, at in edges if 0 <= frame < frames),
            length,
            -margin if start > 0 else 0,
            int(np.ceil(length)) + (margin if stop < frames else 0),
            bank_rate,
        )


@dataclass(frozen=True)
class _Match:
    """A span of a pose bank with similar edges."""

    distance: float  # mm, rms of the markers at the edges
    row: int  # of the bank, of the frame before the blackout
    span: _Span


def similar_windows(
    task: Task,
    search: PoseSearch,
    options: BlackoutOptions,
    correlation: NDArray[np.float64],
    clip: NDArray[np.float64],
    start: int,
    stop: int,
) -> tuple[list[WindowSource], tuple[str, ...]]:
    """Find windows of a task's takes whose edges are similar to those of a blackout.

    Parameters
    ----------
    task : Task
        The clip and the takes.
    search : PoseSearch
        Of these takes.
    options : BlackoutOptions
        Numbers of poses and windows, and the greatest distance of the edges.
    correlation : ndarray [shape=(takes,)]
        Of each take's subject with the clip's.
    clip : ndarray [shape=(frames, markers, 3), mm]
        The clip, filled except in blackouts.
    start, stop : int
        First frame of the blackout, and the frame after its last one.

    Returns
    -------
    sources : list of WindowSource
        At the clip's rate, one window each.
    takes : tuple of str
        Names of the recordings.

    See Also
    --------
    priorfill.methods.gpr.blackout.windows.collect_windows : Collects the windows of all sources.
    """
    edges = [frame for frame in (start - 1, stop) if 0 <= frame < len(clip)]
    markers = np.flatnonzero(np.logical_and.reduce(~np.isnan(clip[edges, :, 0])))
    root = task.root_among(markers) if len(markers) >= MIN_VISIBLE else None
    if root is None or not task.takes or not search.common_markers(markers)[markers].all():
        return [], ()
    by = markers[evenly_spaced(len(markers), options.search_markers)]
    bank = search.bank(root, by, markers, search.options.rate)
    if not len(bank):
        return [], ()
    matches: list[_Match] = []
    for rate in np.unique(bank.rates(bank.rows)):
        span = _Span.of(start, stop, len(clip), task.rate, float(rate), options.edge_seconds)
        rows = _candidates(bank, root, span, clip, options.edge_neighbours)
        distance = _edge_distances(bank, root, span, clip, markers, rows)
        near = distance < options.max_edge_distance
        matches += [
            _Match(float(d), int(row), span)
            for d, row in zip(distance[near], rows[near], strict=True)
        ]
    matches.sort(key=lambda match: match.distance)
    chosen = _spaced(matches, options.window_spacing, options.max_database_windows)
    sources = _read(bank, correlation, chosen, markers, clip.shape[1], task.rate)
    rows = np.array([match.row for match in chosen], dtype=np.intp)
    return sources, take_names(task.takes, bank.take(rows)) if sources else ()


def _candidates(
    bank: PoseBank, root: RootGroup, span: _Span, clip: NDArray[np.float64], count: int
) -> NDArray[np.intp]:
    """Return the rows of a bank at which complete spans begin that have a pose near an edge.

    Parameters
    ----------
    bank : PoseBank
        The poses.
    root : RootGroup
        Of the markers at the edges.
    span : _Span
        What is to be read; only recordings of its rate are used.
    clip : ndarray [shape=(frames, markers, 3), mm]
        The clip.
    count : int
        Nearest poses of each edge.
    """
    rows = []
    for frame, at in span.edges:
        pose = clip[frame][None]
        near = bank.search(pose, root.frames(pose), count)[1][0]
        rows.append(near[bank.rates(near) == span.rate] - at)
    begin: NDArray[np.intp] = np.unique(np.concatenate(rows))
    begin = begin[begin + span.first >= 0]
    first = begin + span.first
    # shifted() returns the row itself where the recording ends earlier
    complete = bank.shifted(first, span.last - span.first) != first
    if span.first < 0:
        complete &= bank.shifted(first, -span.first) == begin
    chosen: NDArray[np.intp] = begin[complete]
    return chosen


def _edge_distances(
    bank: PoseBank,
    root: RootGroup,
    span: _Span,
    clip: NDArray[np.float64],
    markers: NDArray[np.intp],
    rows: NDArray[np.intp],
) -> NDArray[np.float64]:
    """Return the rms distances (mm) of spans' edges from the clip's, in root frames."""
    square = np.zeros(len(rows))
    for frame, at in span.edges:
        poses = np.full((1 + len(rows), clip.shape[1], 3), np.nan)
        poses[0], poses[1:, markers] = clip[frame], bank.positions(rows + at, markers)
        local = root.frames(poses).to_local(poses)[:, markers]
        square += ((local[1:] - local[0]) ** 2).sum(axis=(1, 2))
    distance: NDArray[np.float64] = np.sqrt(square / (len(span.edges) * len(markers)))
    return distance


def _spaced(matches: Iterable[_Match], spacing: float, max_count: int) -> list[_Match]:
    """Return up to ``max_count`` matches, in order, without those too near to a previous one."""
    chosen: list[_Match] = []
    for match in matches:
        if len(chosen) == max_count:
            break
        min_distance = max(1.0, spacing * match.span.length)
        if all(abs(match.row - other.row) >= min_distance for other in chosen):
            chosen.append(match)
    return chosen


def _read(
    bank: PoseBank,
    correlation: NDArray[np.float64],
    matches: Iterable[_Match],
    markers: NDArray[np.intp],
    columns: int,
    rate: float,
) -> list[WindowSource]:
    """Read spans of a bank at the clip's rate (Hz), with a column for each marker of the clip."""
    from scipy.interpolate import CubicSpline  # slow to import

    sources = []
    for match in matches:
        span = match.span
        rows = np.arange(span.first, span.last + 1)
        time = rows / span.rate
        # frames of the clip, counted from the first one of the blackout
        first = int(np.ceil(time[0] * rate)) if span.first < 0 else 1
        frames = np.arange(first, int(time[-1] * rate) + 1) - 1
        recorded = bank.positions(match.row + rows, markers)
        if np.isnan(recorded).any():
            continue
        positions = np.full((len(frames), columns, 3), np.nan)
        positions[:, markers] = CubicSpline(time, recorded)((frames + 1) / rate)
        start = np.array([-int(frames[0])], dtype=np.intp)
        take = bank.take(np.array([match.row]))[0]
        sources.append(WindowSource(positions, float(correlation[take]), start))
    return sources

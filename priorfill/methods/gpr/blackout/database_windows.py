"""Windows of the database whose edges are similar to those of a blackout."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import evenly_spaced
from priorfill.geometry.root_frames import RootGroup
from priorfill.methods.gpr.blackout.body_size import compare_sizes, constant_distances
from priorfill.methods.gpr.blackout.edge_features import edge_features
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.gap_segments import MIN_VISIBLE
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.task import THIS_CLIP, Task, take_names
from priorfill.search.bank import PoseBank, spaced_rows

__all__ = ["DatabaseWindows", "similar_windows"]

SPLINE_MARGIN = 3
"""Frames read on either side of a span, for the spline that resamples it to the clip's rate."""

CANDIDATES = 4
"""Windows that are compared by poses and velocities, for each one that is used: those whose poses
at the edges are the most similar by a few markers."""

WINDOWS_PER_BATCH = 64
"""Windows that are resampled at a time: a second of 41 markers takes 3 MB."""


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


@dataclass(frozen=True, eq=False)
class DatabaseWindows:
    """Windows of recordings of one rate, the most similar one first, read on demand.

    Attributes
    ----------
    bank : PoseBank
        Poses of the recordings.
    rows : ndarray of int [shape=(windows,)]
        Row of the frame before the blackout.
    take : ndarray of int [shape=(windows,)]
        The recording of each window.
    subject : ndarray of int [shape=(windows,)]
        Its subject; `THIS_CLIP` where that is the clip's own.
    correlation : ndarray [shape=(windows,)]
        Of its subject's movements with those of the clip's.
    scale : ndarray [shape=(windows,)]
        Size of the clip's subject in units of the window's.
    """

    bank: PoseBank
    rows: NDArray[np.intp]
    take: NDArray[np.intp]
    subject: NDArray[np.intp]
    correlation: NDArray[np.float64]
    scale: NDArray[np.float64]
    _span: _Span
    _clip_rate: float

    def positions(self, frames: NDArray[np.intp], markers: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return positions in some frames, at the clip's rate and size, by cubic splines.

        Parameters
        ----------
        frames : ndarray of int
            Frames of the clip, counted from the first one of the blackout.
        markers : ndarray of int
            Markers of the clip.

        Returns
        -------
        ndarray [shape=(windows, frames, markers, 3), mm]
        """
        from scipy.interpolate import CubicSpline  # slow to import

        span = self._span
        rows = np.arange(span.first, span.last + 1)
        # a spline is a linear function of the samples that it passes through
        weights = CubicSpline(rows / span.rate, np.eye(len(rows)))((frames + 1) / self._clip_rate)
        found = np.empty((len(self.rows), len(frames), len(markers), 3))
        for at in range(0, len(found), WINDOWS_PER_BATCH):
            part = self.rows[at : at + WINDOWS_PER_BATCH]
            recorded = self.bank.positions((part[:, None] + rows).ravel(), markers)
            recorded = recorded.reshape(len(part), len(rows), -1)
            found[at : at + len(part)] = (weights @ recorded).reshape(-1, *found.shape[1:])
        found *= self.scale[:, None, None, None]
        return found


def similar_windows(
    task: Task,
    search: PoseSearch,
    options: BlackoutOptions,
    correlation: NDArray[np.float64],
    clip: NDArray[np.float64],
    start: int,
    stop: int,
) -> tuple[list[DatabaseWindows], tuple[str, ...]]:
    """Find windows of a task's takes whose edges are similar to those of a blackout.

    Parameters
    ----------
    task : Task
        The clip and the takes.
    search : PoseSearch
        Of these takes.
    options : BlackoutOptions
        Number of windows, and the greatest distance of the edges.
    correlation : ndarray [shape=(takes,)]
        Of each take's subject with the clip's.
    clip : ndarray [shape=(frames, markers, 3), mm]
        The clip, filled except in blackouts.
    start, stop : int
        First frame of the blackout, and the frame after its last one.

    Returns
    -------
    windows : list of DatabaseWindows
        One for each rate of the recordings.
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
    near = [bank.distances(clip[frame][None], root.frames(clip[frame][None])) for frame in edges]
    body = constant_distances(clip[:, markers])
    found: list[DatabaseWindows] = []
    rates = bank.rates(bank.rows)
    for rate in np.unique(rates):
        span = _Span.of(start, stop, len(clip), task.rate, float(rate), options.edge_seconds)
        count = CANDIDATES * options.max_database_windows
        rows = _candidates(bank, span, near, rates == rate, count)
        subject = search.subjects[bank.take(rows)]
        edge = bank.positions(rows + span.edges[0][1], markers)
        size, own = compare_sizes(body, edge, subject)
        poses = _edge_poses(bank, span, clip, task.rate, markers, rows, options)
        poses[1:] *= size[:, None, None, None]
        distance, square = _edge_distances(poses, root.among(markers), span, options)
        near_enough = np.flatnonzero(distance < options.max_edge_distance)
        order = near_enough[np.argsort(square[near_enough], kind="stable")]
        take = bank.take(rows[order])
        spacing = np.full(len(order), max(1.0, options.database_window_spacing * float(rate)))
        places = spaced_rows(rows[order], take, spacing, options.max_database_windows)
        if len(places):
            chosen, take = order[places], take[places]
            found.append(
                DatabaseWindows(
                    bank,
                    rows[chosen],
                    take,
                    np.where(own[chosen], THIS_CLIP, subject[chosen]),
                    np.where(own[chosen], 1.0, correlation[take]),
                    size[chosen],
                    span,
                    task.rate,
                )
            )
    used = np.concatenate([windows.take for windows in found]) if found else np.empty(0, np.intp)
    return found, take_names(task.takes, used) if len(used) else ()


def _candidates(
    bank: PoseBank,
    span: _Span,
    near: list[NDArray[np.float64]],
    eligible: NDArray[np.bool_],
    count: int,
) -> NDArray[np.intp]:
    """Return the rows of a bank at which the complete spans begin that have the nearest poses.

    Parameters
    ----------
    bank : PoseBank
        The poses.
    span : _Span
        What is to be read.
    near : list of ndarray [shape=(rows searched,), mm]
        Distance of each edge of the clip from every pose.
    eligible : ndarray of bool [shape=(rows searched,)]
        Whether they are of recordings of the span's rate.
    count : int
        Number of rows.
    """
    square = np.zeros(len(bank.rows))
    first = span.edges[0][1]
    for (_, at), distance in zip(span.edges, near, strict=True):
        # where not all poses are searched, the one nearest in time is taken
        place = np.searchsorted(bank.rows, bank.rows + (at - first))
        square += distance[np.minimum(place, len(bank.rows) - 1)] ** 2
    begin = bank.rows - first
    usable = eligible & bank.usable_spans(begin, span.first, span.last)
    square, begin = square[usable], begin[usable]
    if len(begin) > count:
        nearest = np.argpartition(square, count - 1)[:count]
        begin = begin[nearest]
    return np.sort(begin)


def _edge_poses(
    bank: PoseBank,
    span: _Span,
    clip: NDArray[np.float64],
    rate: float,
    markers: NDArray[np.intp],
    rows: NDArray[np.intp],
    options: BlackoutOptions,
) -> NDArray[np.float64]:
    """Return poses at the edges, and a step away from each, of the clip first and of spans.

    Returns
    -------
    ndarray [shape=(1 + rows, 2 for each edge, markers, 3), mm]
    """
    step = _step(span, options)
    poses = []
    for frame, at in span.edges:
        side = -1 if at == span.edges[0][1] and span.first < 0 else 1
        earlier = _between(clip, frame + side * step / span.rate * rate)
        for of_clip, offset in ((clip[frame], at), (earlier, at + side * step)):
            recorded = bank.positions(rows + offset, markers)
            poses.append(np.concatenate([of_clip[None, markers], recorded]))
    return np.stack(poses, axis=1)


def _step(span: _Span, options: BlackoutOptions) -> int:
    """Return the frames of a recording between two poses of an edge."""
    return max(1, round(options.difference_seconds * span.rate))


def _edge_distances(
    poses: NDArray[np.float64], root: RootGroup, span: _Span, options: BlackoutOptions
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far the edges of spans are from the clip's.

    Parameters
    ----------
    poses : ndarray [shape=(1 + rows, 2 for each edge, markers, 3), mm]
        As from `_edge_poses`.
    root : RootGroup
        Of these markers.
    span : _Span
        Of the spans.
    options : BlackoutOptions
        Weight of velocities.

    Returns
    -------
    pose : ndarray [shape=(rows,), mm]
        Rms distance of the markers at the edges, each edge in its own root frame.
    square : ndarray [shape=(rows,), mm²]
        Sum of squares over all edge features, poses and velocities in the window's root frame.
    """
    edges = len(span.edges)
    square = np.zeros(len(poses) - 1)
    for edge in range(0, 2 * edges, 2):
        local = root.frames(poses[:, edge]).to_local(poses[:, edge])
        square += ((local[1:] - local[0]) ** 2).sum(axis=(1, 2))
    pose: NDArray[np.float64] = np.sqrt(square / (edges * poses.shape[2]))
    seconds = _step(span, options) / span.rate
    features, _ = edge_features(poses, [2] * edges, root, options, seconds)
    away = ((features[1:] - features[0]) ** 2).sum(axis=1)
    # the clip may show a single frame at an edge, which has no velocity
    return pose, square if np.isnan(away).any() else away


def _between(clip: NDArray[np.float64], at: float) -> NDArray[np.float64]:
    """Return a clip's pose at a time in frames, interpolated linearly, constant at its ends."""
    at = min(max(at, 0.0), len(clip) - 1.0)
    low = int(at)
    high = min(low + 1, len(clip) - 1)
    pose: NDArray[np.float64] = clip[low] + (at - low) * (clip[high] - clip[low])
    return pose

"""Movements of the database that begin and end as the clip does around a blackout."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from priorfill.geometry.poses import evenly_spaced
from priorfill.geometry.root_frames import RootGroup
from priorfill.methods.gpr.blackout.window_layout import REACH
from priorfill.methods.gpr.blackout.windows import OVERLAP, Recording
from priorfill.methods.gpr.gap_segments import FEWEST_VISIBLE
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.pose_search import DATABASE_RATE, OWN_BODY, PoseSearch
from priorfill.methods.gpr.training.subject_correlation import STRANGER_KINSHIP, SYNTHESISED_KINSHIP
from priorfill.methods.task import Task, take_names
from priorfill.search.bank import PoseBank

__all__ = ["similar_movements"]

SIMILAR = 20
"""So many times the neighbours of a pose are asked for where those at both edges must agree."""

SPLINE_MARGIN = 3
"""Frames of the database beside what is read of it, for the spline to the clip's rate."""

OTHER_MOVEMENT = 130.0
"""mm a marker. Stretches whose edges differ by more from a blackout's are of another movement: the
most alike of other people's walks are at 60 to 90, and what is farther off taught nothing."""


@dataclass(frozen=True)
class _Stretch:
    """What is read of a bank, in its frames counted from the one before the blackout.

    Attributes
    ----------
    edges : tuple of (int, int)
        Frame of the clip and frame of the stretch for each edge that is seen.
    length : float
        From the frame before the blackout to the one after it.
    first, last : int
        Of all the frames, those beside the blackout included.
    rate : float
        Of what is read, Hz.
    """

    edges: tuple[tuple[int, int], ...]
    length: float
    first: int
    last: int
    rate: float

    @classmethod
    def of(cls, start: int, stop: int, frames: int, rate: float, read_rate: float) -> _Stretch:
        """Lay out the stretch for a blackout of a clip with so many frames."""
        margin = int(np.ceil((REACH * rate + 2) / rate * read_rate)) + SPLINE_MARGIN
        length = (stop - start + 1) / rate * read_rate
        edges = ((start - 1, 0), (stop, round(length)))
        return cls(
            tuple((frame, at) for frame, at in edges if 0 <= frame < frames),
            length,
            -margin if start > 0 else 0,
            int(np.ceil(length)) + (margin if stop < frames else 0),
            read_rate,
        )


def similar_movements(
    task: Task,
    search: PoseSearch,
    options: GPROptions,
    clip: NDArray[np.float64],
    start: int,
    stop: int,
) -> tuple[list[Recording], tuple[str, ...]]:
    """Find stretches of the database with edges like those of a blackout.

    Parameters
    ----------
    task : Task
        The takes.
    search : PoseSearch
        Of these.
    options : GPROptions
        How many stretches.
    clip : ndarray [shape=(frames, markers, 3), mm]
        Filled but for blackouts.
    start, stop : int
        Of the blackout.

    Returns
    -------
    recordings : list of Recording
        At the clip's rate, none longer than a window.
    takes : tuple of str
        Where they are from.
    """
    edges = [frame for frame in (start - 1, stop) if 0 <= frame < len(clip)]
    markers = np.flatnonzero(np.logical_and.reduce(~np.isnan(clip[edges, :, 0])))
    root = task.root_among(markers) if len(markers) >= FEWEST_VISIBLE else None
    if root is None or not task.takes or not search.shown_with(markers)[markers].all():
        return [], ()
    by = markers[evenly_spaced(len(markers), options.visible)]
    bank = search.bank(root, by, markers, DATABASE_RATE)
    if not len(bank):
        return [], ()
    found: list[tuple[float, int, _Stretch]] = []
    # recordings that were sampled more slowly than the bank was asked for have shorter stretches
    for rate in np.unique(bank.rates(bank.rows)):
        stretch = _Stretch.of(start, stop, len(clip), task.rate, float(rate))
        begin = _candidates(bank, root, stretch, clip, SIMILAR * options.neighbours)
        distance = _unlikeness(bank, root, stretch, clip, markers, begin)
        found += [
            (float(away), int(row), stretch)
            for away, row in zip(distance, begin, strict=True)
            if away < OTHER_MOVEMENT
        ]
    found.sort(key=lambda one: one[0])
    kept = _apart(found, options.movements)
    placed = np.array([take.virtual_markers for take in task.takes])
    kinship = np.where(placed, SYNTHESISED_KINSHIP, STRANGER_KINSHIP)
    kinship[search.bodies == OWN_BODY] = 1.0
    recordings = _read(bank, kinship, kept, markers, clip.shape[1], task.rate)
    names = take_names(task.takes, bank.take(np.array([row for row, _ in kept], dtype=np.intp)))
    return recordings, names if recordings else ()


def _candidates(
    bank: PoseBank, root: RootGroup, stretch: _Stretch, clip: NDArray[np.float64], count: int
) -> NDArray[np.intp]:
    """Return where whole stretches at their rate begin with a pose near one of the edges."""
    rows = []
    for frame, at in stretch.edges:
        here = clip[frame][None]
        near = bank.search(here, root.frames(here), count)[1][0]
        rows.append(near[bank.rates(near) == stretch.rate] - at)
    begin: NDArray[np.intp] = np.unique(np.concatenate(rows))
    begin = begin[begin + stretch.first >= 0]
    inside = begin + stretch.first
    whole = bank.moved(inside, stretch.last - stretch.first) != inside
    if stretch.first < 0:
        whole &= bank.moved(inside, -stretch.first) == begin
    chosen: NDArray[np.intp] = begin[whole]
    return chosen


def _unlikeness(
    bank: PoseBank,
    root: RootGroup,
    stretch: _Stretch,
    clip: NDArray[np.float64],
    markers: NDArray[np.intp],
    begin: NDArray[np.intp],
) -> NDArray[np.float64]:
    """Return the rms distance (mm) a marker of stretches' edges from those of the clip."""
    square = np.zeros(len(begin))
    for frame, at in stretch.edges:
        poses = np.full((1 + len(begin), clip.shape[1], 3), np.nan)
        poses[0], poses[1:, markers] = clip[frame], bank.positions(begin + at, markers)
        local = root.frames(poses).to_local(poses)[:, markers]
        square += ((local[1:] - local[0]) ** 2).sum(axis=(1, 2))
    distance: NDArray[np.float64] = np.sqrt(square / (len(stretch.edges) * len(markers)))
    return distance


def _apart(found: Iterable[tuple[float, int, _Stretch]], most: int) -> list[tuple[int, _Stretch]]:
    """Return rows and stretches of up to ``most`` of what was found, none too near another."""
    kept: list[tuple[int, _Stretch]] = []
    for _, row, stretch in found:
        apart = max(1.0, OVERLAP * stretch.length)
        if all(abs(row - other) >= apart for other, _ in kept):
            kept.append((row, stretch))
        if len(kept) == most:
            break
    return kept


def _read(
    bank: PoseBank,
    kinship: NDArray[np.float64],
    kept: Iterable[tuple[int, _Stretch]],
    markers: NDArray[np.intp],
    columns: int,
    rate: float,
) -> list[Recording]:
    """Read stretches of a bank at the clip's rate (Hz), its number of markers as columns."""
    recordings = []
    for row, stretch in kept:
        rows = np.arange(stretch.first, stretch.last + 1)
        time = rows / stretch.rate
        # clip frames of the same stretch, counted from the blackout's first one
        low = int(np.ceil(time[0] * rate)) if stretch.first < 0 else 1
        frames = np.arange(low, int(time[-1] * rate) + 1) - 1
        there = bank.positions(row + rows, markers)
        if np.isnan(there).any():
            continue
        positions = np.full((len(frames), columns, 3), np.nan)
        positions[:, markers] = CubicSpline(time, there)((frames + 1) / rate)
        at = np.array([-int(frames[0])], dtype=np.intp)
        kin = float(kinship[bank.take(np.array([row]))[0]])
        recordings.append(Recording(positions, kin, at))
    return recordings

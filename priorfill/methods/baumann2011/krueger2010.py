"""Frame-by-frame reconstruction by nearest neighbours: Krüger, Tautges, Weber and Zinke 2010.

Poses are freed from position and heading; each frame's k nearest poses of the database, found by
its visible reliable markers with a kd-tree, say where its missing markers are: at the mean of
theirs, in the frame's own root frame. No frame knows of another, so nothing makes the result
smooth or joins it to what is measured beside a gap. Baumann et al. 2011 compare their method with
this one (table 2); `priorfill.methods.baumann2011.neighbour_votes` shares its search and adds
energies over time.

Where it departs from the publications:

* The publication reconstructs from few markers or sensors of known places; here what a frame is
  searched by changes with what is missing, so there is an index for each set of missing markers,
  and it is not a kd-tree; the poses that it finds are the same.
* All neighbours count the same, as in the published form of `baumann2011`.
* Without a database the clip itself is searched; the publications always have one.
* The database is searched at its rate that is nearest to the clip's.
* What they leave open: with too few reliable markers in sight all visible ones search; markers
  that no pose has together are looked for one by one.

References
----------
.. [K10] Krüger, Tautges, Weber and Zinke, Fast local and global similarity searches in large
   motion capture databases, SCA 2010.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.baumann2011.pose_searches import (
    BATCH_FRAMES,
    DEFAULT_NEIGHBOURS,
    MIN_POSES,
    MIN_VIABLE,
    MarkerSearch,
    SearchPlanner,
)
from priorfill.methods.task import (
    Estimate,
    Note,
    Task,
    take_names,
)
from priorfill.search.bank import PoseBank
from priorfill.search.takes import Take, own_take
from priorfill.signal.resample import pyramid

__all__ = ["Krueger2010Options", "fill"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Krueger2010Options:
    """Options of the method.

    Attributes
    ----------
    neighbours : int
        k; see `DEFAULT_NEIGHBOURS`.
    min_viable : int
        With fewer reliable markers in sight a frame is searched for by all that are.
    min_poses : int
        With fewer poses that have all the wanted markers, they are looked for one by one.
    """

    neighbours: int = DEFAULT_NEIGHBOURS
    min_viable: int = MIN_VIABLE
    min_poses: int = MIN_POSES


def _means(
    bank: PoseBank, search: MarkerSearch, positions: Array, k: int
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Return the neighbours' mean of a search's wanted markers, frame by frame.

    Parameters
    ----------
    bank : PoseBank
        Of the search.
    search : MarkerSearch
        Its viable markers are valid in all of the frames.
    positions : ndarray [shape=(frames, all markers, 3), mm]
        Upright.
    k : int
        How many neighbours.

    Returns
    -------
    mean : ndarray [shape=(frames, wanted markers, 3), mm]
        In the world.
    spread : ndarray [shape=(frames, wanted markers), mm]
        Rms distance of the neighbours from it.
    take : ndarray of int [shape=(frames, neighbours)]
        The takes that they come from.
    """
    roots = search.root.frames(positions)
    _, rows = bank.search(positions, roots, k)
    poses = bank.wanted(rows.ravel()).reshape(*rows.shape, len(search.wanted), 3)
    mean = poses.mean(axis=1)
    spread = np.sqrt(((poses - mean[:, None]) ** 2).sum(axis=3).mean(axis=1))
    return roots.to_world(mean), spread, bank.take(rows)


def _fill_alike(
    task: Task,
    estimate: Estimate,
    planner: SearchPlanner,
    takes: tuple[Take, ...],
    frames: NDArray[np.intp],
    k: int,
) -> None:
    """Fill frames that show the same markers, and note how; changes the estimate."""
    stretches = _stretches(frames)
    plan = planner.plan(task.valid[frames[0]])
    estimate.notes.extend(
        Note(int(marker), start, stop, reason, filled=False)
        for markers, reason in plan.left
        for marker in markers
        for start, stop in stretches
    )
    for search in plan.searches:
        bank = planner.bank(search, task.rate)
        used = []
        for at in range(0, len(frames), BATCH_FRAMES):
            some = frames[at : at + BATCH_FRAMES]
            mean, spread, take = _means(bank, search, task.positions[some], k)
            cells = np.ix_(some, search.wanted)
            estimate.positions[cells] = mean
            estimate.expected_rms[cells] = spread
            used.append(take)
        votes = np.concatenate(used)
        how = f"{k} nearest poses, frame by frame"
        # a bank may hold fewer poses than neighbours are asked for
        names, poses = take_names(takes, votes), votes.shape[1]
        estimate.notes.extend(
            Note(int(marker), start, stop, how, source_clips=names, training_poses=poses)
            for marker in search.wanted
            for start, stop in stretches
        )


def _stretches(frames: NDArray[np.intp]) -> list[tuple[int, int]]:
    """Return the runs of consecutive frames among some, which ascend, as (start, stop)."""
    parts = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
    return [(int(part[0]), int(part[-1]) + 1) for part in parts]


def fill(
    task: Task,
    progress: Callable[[], None] = lambda: None,
    options: Krueger2010Options | None = None,
) -> Estimate:
    """Fill each frame of a task's gaps by the mean of the poses that are nearest to it.

    Parameters
    ----------
    task : Task
        The clip and the takes to learn from; without takes the clip itself is searched.
    progress : callable
        Called once a gap group.
    options : Krueger2010Options, optional
        k, and the bounds that the publications leave open.

    Returns
    -------
    Estimate
        The deviation is the rms spread of the neighbours about their mean. Blackouts, and
        markers that no pose has, stay missing and are noted.
    """
    options = options or Krueger2010Options()
    own = own_take(pyramid(task.positions, task.rate, 1), task.name, task.subject)
    takes = task.takes or (own,)
    planner = SearchPlanner(task, takes, options.min_viable, options.min_poses)
    estimate = Estimate.of(task)
    for group in task.groups:
        shown, which = np.unique(task.valid[group.start : group.stop], axis=0, return_inverse=True)
        for number in range(len(shown)):
            frames = group.start + np.flatnonzero(which.ravel() == number)
            _fill_alike(task, estimate, planner, takes, frames, options.neighbours)
        progress()
    return estimate

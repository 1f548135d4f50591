"""Frame-by-frame reconstruction from nearest poses: Krüger, Tautges, Weber and Zinke 2010 [K10]_.

Poses are compared in root frames, without position and heading. The k poses of the database nearest
to a frame, by the coordinates of its visible reliable markers, predict its missing markers: the
mean of their positions in the frame's own root frame. Frames are independent, so the result is
neither smooth over time nor continuous at the edges of a gap. Baumann et al. 2011 compare their
method with this one (table 2). `priorfill.methods.baumann2011.neighbour_votes` uses the same
search, and adds the energies over time.

Departures from the publications:

* They reconstruct from few markers or sensors in known places, with one index. Here the viable
  markers depend on what is missing, so each set of missing markers has an index of its own. It is
  not a kd-tree, but finds the same poses.
* All neighbours have the same weight, as in Baumann et al. 2011.
* Without a database the clip itself is searched; the publications always have one.
* The database is searched at its rate nearest to the clip's.
* Not stated there: with too few reliable visible markers, all visible ones are compared; markers
  that no pose shows together are searched for one by one.

References
----------
.. [K10] Krüger, Tautges, Weber and Zinke, Fast local and global similarity searches in large
   motion capture databases, SCA 2010.
"""

from __future__ import annotations

from collections.abc import Sequence
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
    Progress,
    Task,
    no_progress,
    take_names,
)
from priorfill.runtime.option_checks import check_at_least
from priorfill.search.bank import PoseBank
from priorfill.search.takes import Take, own_take
from priorfill.signal.resample import pyramid

__all__ = ["Krueger2010Options", "fill"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Krueger2010Options:
    """Options of ``krueger2010``.

    Attributes
    ----------
    neighbours : int
        k, the number of poses averaged per frame; see `DEFAULT_NEIGHBOURS`.
    min_viable : int
        With fewer reliable visible markers in a frame, all its visible markers are compared.
    min_poses : int
        With fewer poses that have all missing markers, markers are searched for one by one.

    Raises
    ------
    OptionError
        Where a value is below its minimum.
    """

    neighbours: int = DEFAULT_NEIGHBOURS
    min_viable: int = MIN_VIABLE
    min_poses: int = MIN_POSES

    def __post_init__(self) -> None:
        check_at_least(self, 1, "neighbours", "min_poses")
        check_at_least(self, 2, "min_viable")


def _means(
    bank: PoseBank, search: MarkerSearch, positions: Array, k: int
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Return the mean of the neighbours' wanted markers, frame by frame.

    Parameters
    ----------
    bank : PoseBank
        The bank of the search.
    search : MarkerSearch
        Its viable markers are measured in all the frames.
    positions : ndarray [shape=(frames, all markers, 3), mm]
        Upright.
    k : int
        Number of neighbours.

    Returns
    -------
    mean : ndarray [shape=(frames, wanted markers, 3), mm]
        In world coordinates.
    spread : ndarray [shape=(frames, wanted markers), mm]
        Rms distance of the neighbours from their mean.
    take : ndarray of int [shape=(frames, neighbours)]
        The take of each neighbour.
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
    markers: Sequence[int],
    k: int,
) -> None:
    """Fill some markers where the same ones are visible, and add notes; changes the estimate."""
    stretches = _stretches(frames)
    plan = planner.plan(task.valid[frames[0]], markers)
    estimate.notes.extend(
        Note(int(marker), start, stop, reason, filled=False)
        for markers, reason in plan.unsearched
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
        source = f"{k} nearest poses, frame by frame"
        # the bank may hold fewer than k poses
        names, poses = take_names(takes, votes), votes.shape[1]
        estimate.notes.extend(
            Note(int(marker), start, stop, source, source_clips=names, training_poses=poses)
            for marker in search.wanted
            for start, stop in stretches
        )


def _stretches(frames: NDArray[np.intp]) -> list[tuple[int, int]]:
    """Return the runs of consecutive frames in an ascending array, as (start, stop)."""
    parts = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
    return [(int(part[0]), int(part[-1]) + 1) for part in parts]


def fill(
    task: Task,
    progress: Progress = no_progress,
    options: Krueger2010Options | None = None,
) -> Estimate:
    """Fill each frame with the mean of the poses nearest to it.

    Parameters
    ----------
    task : Task
        The clip and the takes to search; without takes the clip itself is searched.
    progress : callable
        Called with the number of samples done since the last call.
    options : Krueger2010Options, optional
        The defaults if not given.

    Returns
    -------
    Estimate
        ``expected_rms`` is the rms distance of the neighbours from their mean. Blackouts, and
        markers that no pose shows, stay missing, with a note.

    See Also
    --------
    priorfill.methods.baumann2011.neighbour_votes.fill : The same search with energies over time.
    """
    options = options or Krueger2010Options()
    own = own_take(pyramid(task.positions, task.rate, 1), task.name, task.subject)
    takes = task.takes if task.takes or not task.learn_from_clip else (own,)
    planner = SearchPlanner(task, takes, options.min_viable, options.min_poses)
    estimate = Estimate.of(task)
    for group in task.groups:
        shown, which = np.unique(task.valid[group.start : group.stop], axis=0, return_inverse=True)
        for number in range(len(shown)):
            frames = group.start + np.flatnonzero(which.ravel() == number)
            _fill_alike(task, estimate, planner, takes, frames, group.markers, options.neighbours)
        progress(group.samples)
    return estimate

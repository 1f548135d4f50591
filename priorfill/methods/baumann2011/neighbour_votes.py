"""The published method ``baumann2011``: Baumann, Krüger, Zinke and Weber, VRIPHYS 2011 [B11]_.

Each frame's k nearest poses in the prior database vote, with equal weights, on the positions,
velocities and accelerations of the missing markers. The energy of these votes is minimised from
coarse to fine. Where the parts of the paper are:

=====================================  ==========================================================
root frames, viable markers (4.1)      `priorfill.methods.baumann2011.pose_searches`,
                                       `priorfill.geometry.root_frames`
nearest neighbours y_i (4.1, 4.2)      `_votes`; the search itself is `PoseBank.nearest` in
                                       `priorfill.search.bank`
Eq. (1), E_pose + E_motion + E_smooth  `priorfill.energy.terms.energy`
Eqs. (2)-(4), the sums over the k      `priorfill.energy.terms`; `priorfill.energy.targets.fold`
neighbours                             reduces each sum to one target and one weight
Eq. (5), resolutions                   `priorfill.energy.multiresolution.levels_for`
scheduled descent (4.3)                `priorfill.energy.solver.minimise`
=====================================  ==========================================================

Departures from the paper:

* Search (4.1): without a database, the clip itself is searched; the paper always has a database.
  (`Baumann2011Options.search_own_clip` searches both.) The database is searched at its own
  resolutions, 30 Hz and below by default; finer levels of the clip use its finest one. The search
  is exact, but uses no kd-tree.
* Eqs. (3) and (4): velocities and accelerations are differences in world coordinates. The
  neighbours' poses one step before and after are placed by the root frames of those frames. Where
  the heading of the root is constant, the energy is the paper's.
* Descent (4.3): along conjugate directions and by blocks of frames, not along the gradient and by
  single frames; the minimum is the same. See `priorfill.energy.solver`.
* Not stated in the paper: k, which is chosen by leaving takes out of the database
  (`priorfill.methods.baumann2011.neighbour_count`); a gap group with too few viable markers is
  split where the visible markers change; with too few reliable markers, all visible ones are
  compared; markers that no pose shows together are searched for one by one.

References
----------
.. [B11] J. Baumann, B. Krüger, A. Zinke, A. Weber, Data-driven completion of motion capture data,
   Workshop on Virtual Reality Interaction and Physical Simulation (VRIPHYS), 2011.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.energy.multiresolution import levels_for, solve_levels
from priorfill.energy.solver import Solution, minimise
from priorfill.energy.targets import Prior, fold, to_world
from priorfill.gaps import GapGroup, constant_spans, runs
from priorfill.geometry.root_frames import RootFrames, RootGroup
from priorfill.methods.baumann2011.neighbour_count import NeighbourCount, choose_neighbours
from priorfill.methods.baumann2011.pose_searches import (
    BATCH_FRAMES,
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
from priorfill.runtime.elementary import exp
from priorfill.runtime.option_checks import check_at_least
from priorfill.search.bank import PoseBank
from priorfill.search.takes import own_take
from priorfill.signal.resample import Level, pyramid

__all__ = ["Baumann2011Options", "fill", "vote_weights"]

MIN_BANDWIDTH = 1e-6
"""mm. Lower bound of the width of the vote weights, for neighbours at distance 0."""


@dataclass(frozen=True)
class Baumann2011Options:
    """Options of ``baumann2011``.

    Attributes
    ----------
    neighbours : int or None
        k, the number of poses that vote in each frame. None: chosen for each search by leaving
        takes out of the database (`choose_neighbours`).
    min_viable : int
        A gap group in which fewer viable markers are measured throughout is split; see
        `MIN_VIABLE`.
    min_poses : int
        With fewer poses that have all missing markers, markers are searched for one by one.
    weight_by_distance : bool
        Whether nearer neighbours have larger weights, as in Tautges et al. 2011. The weights of the
        published method are equal.
    search_own_clip : bool
        Whether the clip's own frames are searched in addition to the database.
    batch_frames : int
        Frames whose neighbours are gathered at once; see `BATCH_FRAMES`.

    Raises
    ------
    OptionError
        Where a value is below its minimum.
    """

    neighbours: int | None = None
    min_viable: int = MIN_VIABLE
    min_poses: int = MIN_POSES
    weight_by_distance: bool = False
    search_own_clip: bool = False
    batch_frames: int = BATCH_FRAMES

    def __post_init__(self) -> None:
        check_at_least(self, 1, "min_poses", "batch_frames")
        check_at_least(self, 2, "min_viable")
        if self.neighbours is not None:
            check_at_least(self, 1, "neighbours")


@dataclass(frozen=True, eq=False)
class _SearchedFrames:
    """Frames ``start <= frame < stop`` that share a search for k neighbours."""

    start: int
    stop: int
    search: MarkerSearch
    neighbours: NeighbourCount


def _stretches(
    valid: NDArray[np.bool_],
    reliable: NDArray[np.bool_],
    group: GapGroup,
    options: Baumann2011Options,
) -> list[tuple[int, int]]:
    """Split a gap group into as few stretches as have enough viable markers each."""

    def viable(start: int, stop: int) -> int:
        return int((valid[start:stop].all(axis=0) & reliable).sum())

    if viable(group.start, group.stop) >= options.min_viable:
        return [(group.start, group.stop)]
    stretches: list[tuple[int, int]] = []
    for first, last in constant_spans(valid[group.start : group.stop]):
        start, stop = group.start + first, group.start + last
        if stretches and viable(stretches[-1][0], stop) >= options.min_viable:
            stretches[-1] = (stretches[-1][0], stop)
        else:
            stretches.append((start, stop))
    return stretches


def _planned(
    task: Task, planner: SearchPlanner, group: GapGroup, options: Baumann2011Options
) -> tuple[list[_SearchedFrames], list[Note]]:
    """Plan the searches of a gap group; return notes for markers without a search, too."""
    parts: list[_SearchedFrames] = []
    notes: list[Note] = []
    for start, stop in _stretches(task.valid, planner.reliable, group, options):
        visible = np.logical_and.reduce(task.valid[start:stop], axis=0)
        plan = planner.plan(visible, group.markers)
        for search in plan.searches:
            if options.neighbours is None:
                bank = planner.bank(search, task.rate)
                count = choose_neighbours(bank, search, task.positions[start:stop])
            else:
                count = NeighbourCount.unmeasured(options.neighbours, search)
            parts.append(_SearchedFrames(start, stop, search, count))
        notes += [
            Note(int(marker), start, stop, reason, filled=False)
            for markers, reason in plan.unsearched
            for marker in markers
        ]
    return parts, notes


def _frames_at(
    level: Level, root: RootGroup, numbers: NDArray[np.intp], fallback: RootFrames
) -> tuple[RootFrames, NDArray[np.bool_]]:
    """Return the root frames of some frames of a level, by frame number.

    Where a root marker is missing or the number is outside the level, the fallback is used. Also
    returns where the root frames are the level's own [shape=(frames,)].
    """
    inside = np.clip(numbers, 0, len(level.positions) - 1)
    points = level.positions[inside][:, list(root.markers)]
    known = (inside == numbers) & ~np.isnan(points[..., 0]).any(axis=1)
    frames = root.frames(level.positions[inside])
    return (
        RootFrames(
            np.where(known[:, None], frames.origin, fallback.origin),
            np.where(known[:, None, None], frames.rotation, fallback.rotation),
        ),
        known,
    )


def vote_weights(distance: NDArray[np.float64], *, by_distance: bool) -> NDArray[np.float64]:
    """Return the weight of each neighbour's vote.

    Parameters
    ----------
    distance : ndarray [shape=(frames, k), mm]
        Distances of the neighbours.
    by_distance : bool
        False: all weights are 1. True: exp(-d² / 2h²), with the median distance of the frame's
        neighbours as h, scaled to a sum of k, so that the balance between the terms of the energy
        does not change.

    Returns
    -------
    ndarray [shape=(frames, k)]
        The weights; those of a frame sum to k.

    Examples
    --------
    >>> vote_weights(np.array([[1.0, 2.0, 3.0]]), by_distance=True).round(2)
    array([[1.46, 1.  , 0.54]])
    """
    if not by_distance:
        return np.ones_like(distance)
    width = np.maximum(np.median(distance, axis=1, keepdims=True), MIN_BANDWIDTH)
    weights = exp(-(distance**2) / (2.0 * width**2))
    scaled: NDArray[np.float64] = weights * distance.shape[1] / weights.sum(axis=1, keepdims=True)
    return scaled


def _votes(
    level: Level,
    numbers: NDArray[np.intp],
    part: _SearchedFrames,
    bank: PoseBank,
    options: Baumann2011Options,
) -> tuple[Prior, NDArray[np.float64], NDArray[np.intp]]:
    """Fold the votes of the nearest poses of some frames: the targets of Eqs. (2)-(4).

    Returns the prior [frames, wanted markers], the rms distance (mm) of the neighbours' positions
    from their mean [frames, wanted markers], and the take of each neighbour [frames, k].
    """
    search, positions = part.search, level.positions[numbers]
    here = search.root.frames(positions)
    before, has_before = _frames_at(level, search.root, numbers - 1, here)
    after, has_after = _frames_at(level, search.root, numbers + 1, here)
    found = bank.nearest(positions, here, part.neighbours.k)
    weights = vote_weights(found.distance, by_distance=options.weight_by_distance)
    pose, weight, disagreement = fold(found.pose, weights)
    velocity, _, velocity_disagreement = fold(found.velocity, weights)
    acceleration, _, acceleration_disagreement = fold(found.acceleration, weights)

    spread = np.sqrt(disagreement / np.where(weight > 0, weight, 1.0))
    # the energy is over missing samples only, and over differences whose frames all exist
    weight = np.where(np.isnan(positions[:, search.wanted, 0]), weight, 0.0)
    derivative_weight = np.where((has_before & has_after)[:, None], weight, 0.0)
    constant = np.where(weight > 0, disagreement, 0.0) + np.where(
        derivative_weight > 0, velocity_disagreement + acceleration_disagreement, 0.0
    )
    targets = to_world(pose, velocity, acceleration, before, here, after)
    prior = Prior(*targets, weight, derivative_weight, derivative_weight, constant)
    return prior, spread, found.take


class _GroupPrior:
    """The prior of a gap group at any level, from the votes of its searches.

    At the clip's own rate it also writes the spread of the votes into ``expected_rms``, and keeps
    the take of each vote.
    """

    def __init__(
        self,
        group: GapGroup,
        parts: list[_SearchedFrames],
        planner: SearchPlanner,
        options: Baumann2011Options,
        expected_rms: NDArray[np.float64],
    ) -> None:
        self._group = group
        self._parts = parts
        self._planner = planner
        self._options = options
        self._expected_rms = expected_rms
        self._takes: list[list[NDArray[np.intp]]] = [[] for _ in parts]

    def __call__(self, level: Level, window: NDArray[np.intp]) -> Prior:
        """Return the prior of some frames of a level [frames, markers of the group]."""
        prior = Prior.empty(len(window), len(self._group.markers))
        frames = window * level.step
        for part, takes in zip(self._parts, self._takes, strict=True):
            bank = self._planner.bank(part.search, level.rate)
            if len(bank) == 0:
                continue
            columns = np.searchsorted(self._group.markers, part.search.wanted)
            rows = np.flatnonzero((frames >= part.start) & (frames < part.stop))
            for at in range(0, len(rows), self._options.batch_frames):
                some = rows[at : at + self._options.batch_frames]
                votes, spread, voters = _votes(level, window[some], part, bank, self._options)
                prior.place(some, columns, votes)
                if level.step == 1:
                    takes.append(voters)
                    expected = np.maximum(spread, part.neighbours.rms)
                    self._expected_rms[np.ix_(window[some], part.search.wanted)] = expected
        return prior

    def takes_of(self, part: int) -> NDArray[np.intp]:
        """Return the take of each vote of a part [shape=(frames, k)]."""
        nothing = np.empty((0, self._parts[part].neighbours.k), np.intp)
        return np.concatenate(self._takes[part] or [nothing])


def fill(
    task: Task,
    progress: Progress = no_progress,
    options: Baumann2011Options | None = None,
) -> Estimate:
    """Fill the gaps of a task by the published method [B11]_.

    Parameters
    ----------
    task : Task
        The clip and the takes to search; without takes the clip itself is searched.
    progress : callable
        Called with the number of samples done since the last call.
    options : Baumann2011Options, optional
        The defaults if not given.

    Returns
    -------
    Estimate
        ``expected_rms`` is the larger of two values: the rms distance of the neighbours' positions
        from their mean, which is how far they agree, and the rms error in the takes that were left
        out to choose their number. Blackouts, and markers that no pose shows,
        stay missing, with a note.

    See Also
    --------
    priorfill.methods.baumann2011.weighted_votes.fill : With distance-weighted votes.
    priorfill.methods.baumann2011.krueger2010.fill : Local models, frame by frame.
    """
    options = options or Baumann2011Options()
    levels = pyramid(task.positions, task.rate, levels_for(task.rate))
    own = own_take(levels, task.name, task.subject)
    takes = (*task.takes, own) if options.search_own_clip else task.takes or (own,)
    if not task.learn_from_clip:
        takes = task.takes
    planner = SearchPlanner(task, takes, options.min_viable, options.min_poses)
    estimate = Estimate.of(task)
    for group in task.groups:
        parts, notes = _planned(task, planner, group, options)
        prior_at = _GroupPrior(group, parts, planner, options, estimate.expected_rms)
        if parts:
            inside = solve_levels(levels, group, prior_at, _solver)
            estimate.positions[group.start : group.stop, list(group.markers)] = inside
        estimate.notes.extend(notes)
        for number, part in enumerate(parts):
            votes = prior_at.takes_of(number)
            names = take_names(takes, votes)
            # a bank may hold fewer than k poses
            estimate.notes.extend(_notes(task, part, names, votes.shape[1]))
        progress(group.samples)
    return estimate


def _solver(positions: NDArray[np.float64], free: NDArray[np.bool_], prior: Prior) -> Solution:
    return minimise(positions, free, prior)


def _notes(
    task: Task,
    part: _SearchedFrames,
    names: tuple[str, ...],
    poses: int,
) -> list[Note]:
    """Return a note for each run of missing samples of a part."""
    source = f"{part.neighbours.k} nearest poses by {len(part.search.viable)} markers"
    missing = ~task.valid
    return [
        Note(
            int(marker),
            part.start + start,
            part.start + stop,
            source,
            source_clips=names,
            training_poses=poses,
        )
        for marker in part.search.wanted
        for start, stop in runs(missing[part.start : part.stop, marker])
    ]

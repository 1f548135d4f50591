"""The published method: Baumann, Krüger, Zinke and Weber, VRIPHYS 2011.

Each frame's k nearest poses in the prior database, found by the viable markers in a root frame
that is free of position and heading (sections 4.1, 4.2), vote with equal weights on the
positions, velocities and accelerations of the missing markers; the votes' energy, Eqs. (2)-(4),
is minimised by scheduled gradient descent from coarse to fine (section 4.3).

Where it departs from the paper:

* Without a database the clip itself is searched; the paper always has one.
  (`Baumann2011Options.own` searches both.)
* The database is searched at its own resolutions (30 Hz and below unless it was made with
  another rate); levels finer than that use its finest.
* Differences are taken in the world, with the root frames of the frames they span; where the
  root keeps its heading that is the energy of the paper.
* Descent goes along conjugate directions, by blocks of frames (see `priorfill.energy.solver`): same
  minimum.
* What the paper leaves open: too few viable markers in a gap group split it; markers that no pose
  has together are looked for one by one; with too few reliable markers all valid ones search.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.energy.multiresolution import levels_for, solve_levels
from priorfill.energy.solver import Solution, minimise
from priorfill.energy.targets import Prior, fold, to_world
from priorfill.gaps import GapGroup, constant_spans, runs
from priorfill.geometry.root_frames import RootFrames, RootGroup
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
from priorfill.search.takes import own_take
from priorfill.signal.resample import Level, pyramid

__all__ = ["Baumann2011Options", "fill", "vote_weights"]


@dataclass(frozen=True)
class Baumann2011Options:
    """Options of the published method.

    Attributes
    ----------
    neighbours : int
        k; see `DEFAULT_NEIGHBOURS`.
    min_viable : int
        A gap group is split rather than searched with fewer viable markers; see `MIN_VIABLE`.
    min_poses : int
        With fewer poses that have all the wanted markers, they are looked for one by one.
    kernel : bool
        Weigh the votes by how near their poses are, as Tautges et al. 2011 do; the published
        form counts all the same.
    own : bool
        Search the clip's own frames beside the database.
    chunk : int
        Frames whose neighbours are gathered at once; see `BATCH_FRAMES`.
    """

    neighbours: int = DEFAULT_NEIGHBOURS
    min_viable: int = MIN_VIABLE
    min_poses: int = MIN_POSES
    kernel: bool = False
    own: bool = False
    chunk: int = BATCH_FRAMES


@dataclass(frozen=True, eq=False)
class _Part:
    """Frames ``start <= frame < stop`` searched for together, and how."""

    start: int
    stop: int
    search: MarkerSearch


def _stretches(
    valid: NDArray[np.bool_],
    reliable: NDArray[np.bool_],
    group: GapGroup,
    options: Baumann2011Options,
) -> list[tuple[int, int]]:
    """Split a gap group as little as keeps enough viable markers in each stretch."""

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


def _parts(
    task: Task, planner: SearchPlanner, group: GapGroup, options: Baumann2011Options
) -> tuple[list[_Part], list[Note]]:
    """Plan the searches of a gap group, and note what cannot be searched for."""
    parts: list[_Part] = []
    notes: list[Note] = []
    for start, stop in _stretches(task.valid, planner.reliable, group, options):
        plan = planner.plan(np.logical_and.reduce(task.valid[start:stop], axis=0))
        parts += [_Part(start, stop, search) for search in plan.searches]
        notes += [
            Note(int(marker), start, stop, reason, filled=False)
            for markers, reason in plan.left
            for marker in markers
        ]
    return parts, notes


def _frames_at(
    level: Level, root: RootGroup, numbers: NDArray[np.intp], fallback: RootFrames
) -> tuple[RootFrames, NDArray[np.bool_]]:
    """Root frames of level frames by number; the fallback's where the root is not valid.

    Returns the root frames and where they are the level's own [shape=(frames,)].
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


def vote_weights(distance: NDArray[np.float64], *, kernel: bool) -> NDArray[np.float64]:
    """Return how much each neighbour's vote counts.

    Parameters
    ----------
    distance : ndarray [shape=(frames, k), mm]
        Of the neighbours, ascending.
    kernel : bool
        False: 1 for each. True: exp(-d² / 2 h²) with the median distance of the frame's
        neighbours as h, scaled to a sum of k, so that the energy's terms keep their balance.
    """
    if not kernel:
        return np.ones_like(distance)
    width = np.maximum(np.median(distance, axis=1, keepdims=True), 1e-6)  # mm; equal poses
    nearness = np.exp(-(distance**2) / (2.0 * width**2))
    scaled: NDArray[np.float64] = nearness * distance.shape[1] / nearness.sum(axis=1, keepdims=True)
    return scaled


def _votes(
    level: Level,
    numbers: NDArray[np.intp],
    search: MarkerSearch,
    bank: PoseBank,
    options: Baumann2011Options,
) -> tuple[Prior, NDArray[np.float64], NDArray[np.intp]]:
    """Let the neighbours of some frames of a level vote on a search's wanted markers.

    Returns the prior [frames, wanted markers], the rms distance (mm) of the positions voted for
    from their mean [frames, wanted markers], and the takes that voted [frames, k].
    """
    positions = level.positions[numbers]
    here = search.root.frames(positions)
    before, has_before = _frames_at(level, search.root, numbers - 1, here)
    after, has_after = _frames_at(level, search.root, numbers + 1, here)
    found = bank.nearest(positions, here, options.neighbours)
    weights = vote_weights(found.distance, kernel=options.kernel)
    pose, weight, disagreement = fold(found.pose, weights)
    velocity, _, velocity_disagreement = fold(found.velocity, weights)
    acceleration, _, acceleration_disagreement = fold(found.acceleration, weights)

    spread = np.sqrt(disagreement / np.where(weight > 0, weight, 1.0))
    # the energy is over the missing samples only, and over differences that exist
    weight = np.where(np.isnan(positions[:, search.wanted, 0]), weight, 0.0)
    derivative_weight = np.where((has_before & has_after)[:, None], weight, 0.0)
    constant = np.where(weight > 0, disagreement, 0.0) + np.where(
        derivative_weight > 0, velocity_disagreement + acceleration_disagreement, 0.0
    )
    targets = to_world(pose, velocity, acceleration, before, here, after)
    prior = Prior(*targets, weight, derivative_weight, derivative_weight, constant)
    return prior, spread, found.take


def fill(
    task: Task,
    progress: Callable[[], None] = lambda: None,
    options: Baumann2011Options | None = None,
) -> Estimate:
    """Fill the gaps of a task by the published method.

    Parameters
    ----------
    task : Task
        The clip and the takes to learn from; without takes the clip itself is searched.
    progress : callable
        Called once a gap group.
    options : Baumann2011Options, optional
        k and the bounds that the paper leaves open.

    Returns
    -------
    Estimate
        The deviation is the rms spread of the neighbours about their mean. Blackouts, and
        markers that no pose has, stay missing and are noted.
    """
    options = options or Baumann2011Options()
    levels = pyramid(task.positions, task.rate, levels_for(task.rate))
    own = own_take(levels, task.name, task.subject)
    takes = (*task.takes, own) if options.own else task.takes or (own,)
    planner = SearchPlanner(task, takes, options.min_viable, options.min_poses)
    estimate = Estimate.of(task)
    for group in task.groups:
        parts, notes = _parts(task, planner, group, options)
        used: dict[int, list[NDArray[np.intp]]] = {i: [] for i in range(len(parts))}

        def prior_at(
            level: Level,
            window: NDArray[np.intp],
            group: GapGroup = group,
            parts: list[_Part] = parts,
            used: dict[int, list[NDArray[np.intp]]] = used,
        ) -> Prior:
            prior = Prior.empty(len(window), len(group.markers))
            for i, part in enumerate(parts):
                search = part.search
                bank = planner.bank(search, level.rate)
                columns = np.searchsorted(group.markers, search.wanted)
                frames = window * level.step
                rows = np.flatnonzero((frames >= part.start) & (frames < part.stop))
                if len(bank) == 0:
                    continue
                for at in range(0, len(rows), options.chunk):
                    some = rows[at : at + options.chunk]
                    votes, spread, voters = _votes(level, window[some], search, bank, options)
                    prior.place(some, columns, votes)
                    if level.step == 1:
                        used[i].append(voters)
                        estimate.expected_rms[np.ix_(window[some], search.wanted)] = spread
            return prior

        if parts:
            inside = solve_levels(levels, group, prior_at, _solver)
            estimate.positions[group.start : group.stop, list(group.markers)] = inside
        estimate.notes.extend(notes)
        for i, part in enumerate(parts):
            votes = np.concatenate(used[i] or [np.empty((0, options.neighbours), np.intp)])
            names = take_names(takes, votes)
            # a bank may hold fewer poses than neighbours are asked for
            estimate.notes.extend(_notes(task, part, names, options, votes.shape[1]))
        progress()
    return estimate


def _solver(positions: NDArray[np.float64], free: NDArray[np.bool_], prior: Prior) -> Solution:
    return minimise(positions, free, prior)


def _notes(
    task: Task, part: _Part, names: tuple[str, ...], options: Baumann2011Options, poses: int
) -> list[Note]:
    """Say for each run of missing samples of a part what it was filled from."""
    how = f"{options.neighbours} nearest poses by {len(part.search.viable)} markers"
    missing = ~task.valid
    return [
        Note(
            int(marker),
            part.start + start,
            part.start + stop,
            how,
            source_clips=names,
            training_poses=poses,
        )
        for marker in part.search.wanted
        for start, stop in runs(missing[part.start : part.stop, marker])
    ]

"""Frame-by-frame optimisation with local models of a database: the comparator of [B11]_.

Baumann et al. 2011 compare their method in table 2 with a reconstruction that they call a fast
search for the method of Chai and Hodgins 2005 [C05]_, after Krüger et al. 2010 [K10]_: each frame
is optimised by itself, with an ad hoc term for smoothness. For each frame, the k poses of the
database nearest by the visible reliable markers in root frames are a local model, a normal
distribution of poses with mean and covariance. The pose z of the frame minimises

    E = E_prior + E_control + E_smooth
    E_prior   = (z - mean)ᵀ covariance⁻¹ (z - mean)
    E_control = |viable markers of z - measured ones|² / c²
    E_smooth  = |x[t] - 2 x[t-1] + x[t-2]|² / s²

where x are the missing markers of z in the world; E_smooth uses what the two frames before were
filled with, or measured. Frames are filled in the order of time and are not changed by later ones,
so that a fill is continuous where a gap begins, but not where it ends.
`priorfill.methods.baumann2011.neighbour_votes` uses the same search, and energies over all frames.

The minimum is that of a normal distribution conditioned on measurements: first on the viable
markers, then on the extrapolation 2 x[t-1] - x[t-2].

Departures from the publications, and what they do not state:

* Models of markers, not of the joint angles of a skeleton. All principal components are kept:
  E_prior weighs them by their variance.
* The weights of the terms are not stated by [B11]_; here they are the distances c and s,
  `Krueger2010Options.control_error` and `Krueger2010Options.second_difference`. Nor is k.
* Each set of missing markers has an index of its own: the viable markers depend on what is missing.
* Without a database the clip itself is searched; the publications always have one.
* The database is searched at its rate nearest to the clip's.
* With too few reliable visible markers, all visible ones are compared; markers that no pose shows
  together are searched for one by one.

References
----------
.. [B11] Baumann, Krüger, Zinke and Weber, Data-driven completion of motion capture data,
   VRIPHYS 2011.
.. [C05] Chai and Hodgins, Performance animation from low-dimensional control signals, ACM
   Transactions on Graphics 24, 2005. doi:10.1145/1073204.1073248
.. [K10] Krüger, Tautges, Weber and Zinke, Fast local and global similarity searches in large
   motion capture databases, SCA 2010.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import constant_spans
from priorfill.geometry.root_frames import RootFrames
from priorfill.methods.baumann2011.pose_searches import (
    BATCH_FRAMES,
    MIN_POSES,
    MIN_VIABLE,
    MarkerSearch,
    SearchPlan,
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
from priorfill.search.takes import own_take
from priorfill.signal.resample import pyramid

__all__ = ["Krueger2010Options", "fill"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Krueger2010Options:
    """Options of ``krueger2010``.

    Attributes
    ----------
    neighbours : int
        k, the number of poses of a local model. In a library of eleven minutes, the errors of limbs
        are 84 mm with 64 and 99 mm with 256, those of single markers 41 and 40 mm.
    control_error : float
        mm. Usual difference of a coordinate of a viable marker from the local model, as of people
        of different size. The same errors with 20, 40 and 100 mm: limbs 84, 81 and 94 mm, single
        markers 41, 45 and 53 mm.
    second_difference : float
        mm. s, the usual second difference of a coordinate of a missing marker. Where it is well
        below the spread of the local model, each frame continues the motion of the two before, and
        the fill swings about the model's mean instead of following it: an arm in a jump is 110 mm
        off with 200 mm, 106 with 100, and 295 with 50.
    min_viable : int
        With fewer reliable visible markers in a frame, all its visible markers are compared.
    min_poses : int
        With fewer poses that have all missing markers, markers are searched for one by one.

    Raises
    ------
    OptionError
        Where a value is below its minimum.
    """

    neighbours: int = 64
    control_error: float = 40.0
    second_difference: float = 200.0
    min_viable: int = MIN_VIABLE
    min_poses: int = MIN_POSES

    def __post_init__(self) -> None:
        check_at_least(self, 1, "neighbours", "min_poses")
        check_at_least(self, 2, "min_viable")
        check_at_least(self, 0.001, "control_error", "second_difference")


@dataclass(frozen=True, eq=False)
class _Predicted:
    """Wanted markers of some frames, predicted by their local models.

    Attributes
    ----------
    mean : ndarray [shape=(frames, 3 * wanted markers), mm]
        In the frames' own root frames.
    covariance : ndarray [shape=(frames, 3 * wanted markers, 3 * wanted markers), mm²]
    roots : RootFrames
        The root frames.
    take : ndarray of int [shape=(frames, k)]
        The take of each pose of the models.
    """

    mean: Array
    covariance: Array
    roots: RootFrames
    take: NDArray[np.intp]


def _predict(
    bank: PoseBank, search: MarkerSearch, positions: Array, options: Krueger2010Options
) -> _Predicted:
    """Minimise E_prior + E_control for some frames [shape=(frames, all markers, 3), mm]."""
    roots = search.root.frames(positions)
    _, rows = bank.search(positions, roots, options.neighbours)
    poses = bank.local(rows.ravel(), np.concatenate([search.viable, search.wanted]))
    poses = poses.reshape(*rows.shape, -1)
    seen = 3 * len(search.viable)
    mean = poses.mean(axis=1)
    from_mean = poses - mean[:, None]
    covariance = np.swapaxes(from_mean, 1, 2) @ from_mean / max(rows.shape[1] - 1, 1)
    measured = roots.to_local(positions[:, search.viable]).reshape(len(rows), -1)
    found, left = _conditioned(
        mean, covariance, np.arange(seen), measured, options.control_error**2
    )
    return _Predicted(found[:, seen:], left[:, seen:, seen:], roots, bank.take(rows))


def _conditioned(
    mean: Array, covariance: Array, known: NDArray[np.intp], values: Array, noise: float
) -> tuple[Array, Array]:
    """Condition normal distributions on measurements of some of their coordinates.

    Parameters
    ----------
    mean : ndarray [shape=(frames, coordinates)]
    covariance : ndarray [shape=(frames, coordinates, coordinates)]
    known : ndarray of int [shape=(measured coordinates,)]
    values : ndarray [shape=(frames, measured coordinates)]
    noise : float
        Variance of the measurements.

    Returns
    -------
    mean, covariance : ndarray
    """
    across = covariance[:, known]
    measured = across[:, :, known] + noise * np.eye(len(known))
    gain = np.swapaxes(np.linalg.solve(measured, across), 1, 2)
    moved = mean + np.einsum("fij,fj->fi", gain, values - mean[:, known])
    return moved, covariance - gain @ across


def _place(
    predicted: _Predicted,
    filled: Array,
    frames: range,
    wanted: NDArray[np.intp],
    deviation: float,
) -> None:
    """Add E_smooth frame by frame, and write the result into ``filled``.

    Parameters
    ----------
    predicted : _Predicted
        The minimum without E_smooth.
    filled : ndarray [shape=(frames, all markers, 3), mm]
        The clip; changed in the frames.
    frames : range
        The frames that are predicted.
    wanted : ndarray of int
        The markers that are predicted.
    deviation : float
        mm. s, the usual second difference.
    """
    local = predicted.mean.reshape(len(frames), len(wanted), 3)
    for number, frame in enumerate(frames):
        roots = RootFrames(
            predicted.roots.origin[number : number + 1],
            predicted.roots.rotation[number : number + 1],
        )
        if frame >= 2:
            straight = 2.0 * filled[frame - 1, wanted] - filled[frame - 2, wanted]
            known = np.flatnonzero(np.isfinite(straight).all(axis=1))
            columns = (3 * known[:, None] + np.arange(3)).ravel()
            moved, _ = _conditioned(
                predicted.mean[number : number + 1],
                predicted.covariance[number : number + 1],
                columns,
                roots.to_local(straight[None, known]).reshape(1, -1),
                deviation**2,
            )
            local[number] = moved.reshape(len(wanted), 3)
        filled[frame, wanted] = roots.to_world(local[number : number + 1])[0]


def _fill_alike(
    task: Task,
    estimate: Estimate,
    planner: SearchPlanner,
    search: MarkerSearch,
    span: range,
    options: Krueger2010Options,
) -> NDArray[np.intp]:
    """Fill the wanted markers of a search in frames with the same visible markers.

    Changes the estimate. Returns the take of each pose of the local models [shape=(frames, k)].
    """
    bank = planner.bank(search, task.rate)
    takes = []
    for at in range(span.start, span.stop, BATCH_FRAMES):
        frames = range(at, min(at + BATCH_FRAMES, span.stop))
        predicted = _predict(bank, search, task.positions[frames.start : frames.stop], options)
        _place(predicted, estimate.positions, frames, search.wanted, options.second_difference)
        variance = np.diagonal(predicted.covariance, axis1=1, axis2=2)
        square = variance.reshape(len(frames), -1, 3).sum(axis=2)
        estimate.expected_rms[frames.start : frames.stop, search.wanted] = np.sqrt(
            np.maximum(square, 0.0)
        )
        takes.append(predicted.take)
    return np.concatenate(takes)


def fill(
    task: Task,
    progress: Progress = no_progress,
    options: Krueger2010Options | None = None,
) -> Estimate:
    """Fill frame by frame with local models of the poses nearest to each.

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
        ``expected_rms`` is the standard deviation of the local model where it agrees with the
        viable markers. Blackouts, and markers that no pose shows, stay missing, with a note.

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
        plans: dict[bytes, SearchPlan] = {}
        for first, last in constant_spans(task.valid[group.start : group.stop]):
            span = range(group.start + first, group.start + last)
            visible = task.valid[span.start]
            if visible.tobytes() not in plans:
                plans[visible.tobytes()] = planner.plan(visible, group.markers)
            plan = plans[visible.tobytes()]
            estimate.notes.extend(
                Note(int(marker), span.start, span.stop, reason, filled=False)
                for markers, reason in plan.unsearched
                for marker in markers
            )
            for search in plan.searches:
                used = _fill_alike(task, estimate, planner, search, span, options)
                estimate.notes.extend(_notes(search, span, take_names(takes, used), used.shape[1]))
        progress(group.samples)
    return estimate


def _notes(search: MarkerSearch, span: range, names: tuple[str, ...], poses: int) -> Iterator[Note]:
    """Yield a note for each marker of a search; a bank may hold fewer poses than k."""
    source = f"local models of {poses} nearest poses, frame by frame"
    for marker in search.wanted:
        yield Note(
            int(marker), span.start, span.stop, source, source_clips=names, training_poses=poses
        )

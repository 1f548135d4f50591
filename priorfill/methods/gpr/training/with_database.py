"""Regression problems of the clip and the database together: training poses of other subjects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import evenly_spaced
from priorfill.geometry.root_frames import RootGroup
from priorfill.gp.problem import GPModel, PoseSamples, RegressionProblem, SimulatedGap
from priorfill.methods.gpr.gap_segments import MIN_VISIBLE
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.sources.simulated_gaps import SimulatedPlace, SimulatedPlaces
from priorfill.methods.gpr.training.lagged_poses import complete_lagged
from priorfill.methods.gpr.training.options import TrainingOptions
from priorfill.methods.gpr.training.own_clip import OwnClipProblem
from priorfill.methods.gpr.training.same_subject import body_differences
from priorfill.methods.gpr.training.subject_correlation import (
    SubjectCorrelationOptions,
    take_correlations,
)
from priorfill.methods.gpr.training.subject_offsets import subject_offsets
from priorfill.methods.task import MIRROR_IMAGE, THIS_CLIP, Task, take_names
from priorfill.runtime.elementary import log
from priorfill.search.bank import PoseBank

__all__ = ["problem_with_database"]


def problem_with_database(
    own: OwnClipProblem,
    task: Task,
    search: PoseSearch,
    options: TrainingOptions,
    correlation: SubjectCorrelationOptions,
    models: Sequence[GPModel],
    simulation_models: Sequence[GPModel],
) -> tuple[RegressionProblem, tuple[str, ...]] | None:
    """Make a problem of poses of the clip, its mirror image and the database.

    Parameters
    ----------
    own : OwnClipProblem
        With lag features, and with poses of the mirror image if there are any.
    task : Task
        The clip and the takes.
    search : PoseSearch
        Of these takes.
    options : TrainingOptions
        Number of poses.
    correlation : SubjectCorrelationOptions
        Correlations of the takes' subjects.
    models : sequence of GPModel
        Those that are fitted to the problem.
    simulation_models : sequence of GPModel
        Those that predict simulated gaps from each recording's own poses.

    Returns
    -------
    problem : RegressionProblem
    takes : tuple of str
        Names of the takes whose poses are used.

    None instead of both where the database has too few poses with the markers, or none is wanted.

    See Also
    --------
    priorfill.methods.gpr.training.own_clip.OwnClipProblems : Problems of the clip alone.
    """
    if not task.takes:
        return None
    columns = np.flatnonzero(search.common_markers(own.markers)[own.visible])
    visible = own.visible[columns]
    root = task.root_among(visible)
    if len(columns) < MIN_VISIBLE or root is None:
        return None
    needed = np.concatenate([own.markers, visible])
    searched = visible[: search.options.max_markers]
    bank = search.bank(root, searched, needed, options.database.rate, on_clips_body=True)
    if len(bank) < options.min_poses:
        return None
    chosen = _Training(own, search, root, bank, columns, *_chosen_rows(own, options, task.rate))
    near_gap = chosen.rows_near_gap(options)
    simulation = chosen.simulation(task, options)
    places = simulation.find(near_gap)
    bank_rows = chosen.with_other_rows(near_gap, places, options)
    if not len(bank_rows):  # the options ask for none
        return None
    poses = chosen.poses(bank_rows, options, correlation)
    shown = np.logical_and.reduce(task.valid[:, own.markers], axis=1).sum() / task.rate
    problem = own.problem
    source = problem.lag_source
    return RegressionProblem(
        poses,
        replace(problem.query, visible=problem.query.visible[:, columns]),
        problem.distance[columns],
        problem.spread[columns],
        _error_penalty(shown, options),
        options.database.offset_variance,
        None if source is None else source.restricted_to(columns),
        models,
        chosen.simulated_gaps(simulation, places, bank_rows, poses, simulation_models),
    ), take_names(task.takes, bank.take(bank_rows))


def _error_penalty(shown_seconds: float, options: TrainingOptions) -> float:
    """Return the penalty for a clip that shows the missing markers for some time."""
    doublings = float(log(shown_seconds / options.database.sufficient_seconds) / log(2.0))
    return 1.0 + options.database.penalty_per_doubling * max(-1.0, doublings)


def _chosen_rows(
    own: OwnClipProblem, options: TrainingOptions, rate: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Choose the training poses of the clip and of its mirror image, as rows of its problem."""
    train = own.problem.train
    clip, image = (np.flatnonzero(train.recording == n) for n in (THIS_CLIP, MIRROR_IMAGE))
    frames = np.round(train.time * rate).astype(np.intp)
    adjacent = clip[np.isin(frames[clip], own.adjacent)]
    spaced = clip[evenly_spaced(len(clip), options.database.own_poses)]
    return (
        np.union1d(adjacent, spaced),
        image[evenly_spaced(len(image), options.database.mirror_poses)],
    )


@dataclass(frozen=True, eq=False)
class _Training:
    """The data of a problem with the database, in three index spaces.

    ``columns`` index the visible markers of the clip's own problem; ``clip_rows`` and
    ``image_rows`` its training poses; bank rows, the poses of the bank.
    """

    own: OwnClipProblem
    search: PoseSearch
    root: RootGroup
    bank: PoseBank
    columns: NDArray[np.intp]
    clip_rows: NDArray[np.intp]
    image_rows: NDArray[np.intp]

    @property
    def visible(self) -> NDArray[np.intp]:
        """Visible markers of the problem, as markers of the clip."""
        return self.own.visible[self.columns]

    @property
    def own_rows(self) -> NDArray[np.intp]:
        """Training poses of the clip, then of its mirror image."""
        return np.concatenate([self.clip_rows, self.image_rows])

    def poses(
        self,
        bank_rows: NDArray[np.intp],
        options: TrainingOptions,
        correlation: SubjectCorrelationOptions,
    ) -> PoseSamples:
        """Return the poses of the clip, its mirror image and the database, in this order."""
        bank, own, rows = self.bank, self.own.problem.train, self.own_rows
        take = bank.take(bank_rows)
        visible, missing = (bank.positions(bank_rows, m) for m in (self.visible, self._missing))
        subject = self._subjects(take, visible, missing, correlation)
        offset = self._world_offsets(visible, subject)
        others = take_correlations(self.search.task.takes, self.search.subjects, correlation)[take]
        own_correlation = np.ones(len(own.time)) if own.correlation is None else own.correlation
        return PoseSamples(
            np.concatenate([own.visible[rows][:, self.columns], visible + offset]),
            np.concatenate([own.missing[rows], missing]),
            np.concatenate([own.time[rows], bank_rows / bank.rates(bank_rows)]),
            np.concatenate([own.recording[rows], take]),
            np.concatenate([own_correlation[rows], np.where(subject == THIS_CLIP, 1.0, others)]),
            np.concatenate([own.recording[rows], subject]),
            self._lagged(bank_rows, visible, offset),
            self._velocity(bank_rows, options.velocity_seconds),
        )

    def _subjects(
        self,
        take: NDArray[np.intp],
        visible: NDArray[np.float64],
        missing: NDArray[np.float64],
        options: SubjectCorrelationOptions,
    ) -> NDArray[np.intp]:
        """Return the subject of each pose of the database; `THIS_CLIP` for the clip's own."""
        if self.bank.is_mapped:  # all have the clip's distances then, and none is its own
            return self.search.subjects[take]
        own, task = self.own.problem.train, self.search.task
        clip = own.visible[self.clip_rows][:, self.columns], own.missing[self.clip_rows]
        near = slice(self.search.options.max_markers)
        difference = body_differences(
            np.concatenate([part[:, near] for part in clip], axis=1),
            np.concatenate([visible[:, near], missing[:, near]], axis=1),
            take,
        )
        same_name = [t.subject != "" and t.subject == task.subject for t in task.takes]
        virtual = np.array([t.virtual_markers for t in task.takes], dtype=bool)
        limit = np.where(same_name, options.same_name_distance, options.same_subject_distance)
        # virtual markers are not placed where the subject's markers were
        same = (difference <= limit[take]) & ~virtual[take]
        return np.where(same, THIS_CLIP, self.search.subjects[take])

    @property
    def _missing(self) -> NDArray[np.intp]:
        return self.own.markers

    def rows_near_gap(self, options: TrainingOptions) -> NDArray[np.intp]:
        """Choose poses of the bank near the queries."""
        poses, count = self.own.problem.query.visible[:, self.columns], options.database
        dense = max(count.clip_neighbours, int(count.gap_share * len(self.bank)))
        return self._nearest(poses, min(count.gap_neighbours, dense))[: count.gap_poses]

    def with_other_rows(
        self,
        near_gap: NDArray[np.intp],
        places: Sequence[SimulatedPlace],
        options: TrainingOptions,
    ) -> NDArray[np.intp]:
        """Add poses next to simulated gaps, then ones near the clip's training poses."""
        count = options.database
        contexts = [place.context(options.simulated_gaps.context_poses) for place in places]
        context = np.unique(np.concatenate([near_gap[:0], *contexts]))
        rows = np.concatenate([near_gap, context[~np.isin(context, near_gap)]])
        poses = self.own.problem.train.visible[self.clip_rows][:, self.columns]
        near_clip = self._nearest(poses, count.clip_neighbours)
        near_clip = near_clip[~np.isin(near_clip, rows)]
        missing = len(near_gap) + count.other_poses - len(rows)
        return np.concatenate([rows, near_clip[: max(missing, 0)]])

    def _nearest(self, poses: NDArray[np.float64], neighbours: int) -> NDArray[np.intp]:
        return self.search.nearest(self.bank, self.root, self.visible, poses, neighbours)

    def simulation(self, task: Task, options: TrainingOptions) -> SimulatedPlaces:
        """Return what simulates the longest segment of the gap in the bank."""
        own, query = self.own, self.own.problem.query
        longest = max(own.queries, key=lambda part: part.stop - part.start)
        rows = longest.start + np.flatnonzero(own.inside[longest])
        gap = PoseSamples(
            query.visible[rows][:, self.columns],
            query.missing[rows],
            query.time[rows],
            query.recording[rows],
        )
        seconds = len(task.positions) / task.rate
        return SimulatedPlaces(
            self.bank,
            self.root,
            self.search,
            self.visible,
            self._missing,
            gap,
            float(gap.time[0]),
            seconds - float(gap.time[-1]),
            options.simulated_gaps,
        )

    def simulated_gaps(
        self,
        simulation: SimulatedPlaces,
        places: Sequence[SimulatedPlace],
        bank_rows: NDArray[np.intp],
        poses: PoseSamples,
        models: Sequence[GPModel],
    ) -> tuple[SimulatedGap, ...]:
        """Predict the places from their takes' own poses, where enough of them are trained with."""
        problem = self.own.problem
        distance, spread = problem.distance[self.columns], problem.spread[self.columns]
        image = problem.train.recording == MIRROR_IMAGE
        correlation = problem.train.correlation
        mirror = None
        if image.any() and correlation is not None:
            mirror = float(correlation[image][0])
        first = len(self.own_rows)
        found = []
        for place in places:
            at = np.flatnonzero(np.isin(bank_rows, place.gap_rows))
            if len(at) < simulation.options.min_gap_poses:
                continue
            own = simulation.predict_own(place, models, distance, spread, mirror)
            rows = np.searchsorted(place.gap_rows, bank_rows[at])
            measured = self.bank.positions(bank_rows[at], self._missing)
            offset = poses.visible[first + at] - self.bank.positions(bank_rows[at], self.visible)
            found.append(
                SimulatedGap(
                    first + at,
                    measured - own.positions[rows],
                    own.expected_rms[rows],
                    simulation.options.likeness(offset),
                )
            )
        return tuple(found)

    def _world_offsets(
        self, visible: NDArray[np.float64], subject: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Return what fits poses of other subjects to the clip's [shape of visible, mm]."""
        own_visible = self.own.problem.train.visible[self.own_rows][:, self.columns]
        own_frames, bank_frames = (
            self.root.frames(self.search.in_clip_order(self.visible, poses))
            for poses in (own_visible, visible)
        )
        local = subject_offsets(
            own_frames.to_local(own_visible), bank_frames.to_local(visible), subject
        )
        local[subject == THIS_CLIP] = 0.0  # other recordings of the same subject
        offset: NDArray[np.float64] = local @ np.swapaxes(bank_frames.rotation, 1, 2)
        return offset

    def _lagged(
        self,
        bank_rows: NDArray[np.intp],
        visible: NDArray[np.float64],
        offset: NDArray[np.float64],
    ) -> dict[float, NDArray[np.float64]]:
        """Return lagged positions, without lags shorter than half a step of the bank."""
        rates = self.bank.rates(bank_rows)
        lagged = {}
        for lag, positions in self.own.problem.train.lagged.items():
            steps = lag * rates
            if not np.round(steps).any():
                continue
            before, after = (
                _moved(self.bank, bank_rows, self.visible, d) + offset for d in (-steps, steps)
            )
            own = positions[:, self.own_rows][:, :, self.columns]
            bank = complete_lagged(visible + offset, before, after)
            lagged[lag] = np.concatenate([own, bank], axis=1)
        return lagged

    def _velocity(self, bank_rows: NDArray[np.intp], seconds: float) -> NDArray[np.float64] | None:
        """Return the velocities of the missing markers [mm/s], by differences over ``2 seconds``.

        None where the clip's own problem has none.
        """
        own = self.own.problem.train.velocity
        if own is None:
            return None
        steps = seconds * self.bank.rates(bank_rows)
        before, after = complete_lagged(
            self.bank.positions(bank_rows, self._missing),
            *(_moved(self.bank, bank_rows, self._missing, d) for d in (-steps, steps)),
        )
        return np.concatenate([own[self.own_rows], (after - before) / (2.0 * seconds)])


def _moved(
    bank: PoseBank, rows: NDArray[np.intp], markers: NDArray[np.intp], steps: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return positions some steps of a bank after its rows, linearly interpolated.

    Parameters
    ----------
    bank : PoseBank
        The poses.
    rows, markers : ndarray of int [shapes=(rows,), (markers,)]
        Which positions.
    steps : ndarray [shape=(rows,)]
        Of each row; may be negative and have fractions.
    """
    whole_steps = np.trunc(steps).astype(np.intp)
    fraction = np.abs(steps - whole_steps)[:, None, None]
    at = bank.shifted(rows, whole_steps)
    following = bank.shifted(at, np.sign(steps).astype(np.intp))
    moved: NDArray[np.float64] = bank.positions(at, markers)
    between = (fraction > 0.0)[:, 0, 0]
    step = bank.positions(following[between], markers) - moved[between]
    moved[between] += fraction[between] * step
    return moved

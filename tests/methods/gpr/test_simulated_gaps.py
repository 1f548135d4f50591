"""Places in other recordings that are like a gap, and their prediction by the own poses there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gappy import ARM, person, with_gaps

from priorfill.clip import Clip
from priorfill.gaps import gap_groups
from priorfill.gp.problem import PoseSamples
from priorfill.markers.describe import describe
from priorfill.methods.gpr.ensembles import ModelOptions
from priorfill.methods.gpr.gap_segments import SegmentBatch
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.segment_batches import split_into_batches
from priorfill.methods.gpr.sources.simulated_gaps import SimulatedGapOptions, SimulatedPlaces
from priorfill.methods.gpr.training.plan import TrainingPlanner
from priorfill.methods.task import Task
from priorfill.search.takes import same_subject_take

START, STOP = 90, 120


def task_with_takes(*others: Clip) -> Task:
    clip = with_gaps(person(), (START, STOP, ARM))
    groups = tuple(gap_groups(clip.missing))
    takes = [same_subject_take(other, clip.labels) for other in others]
    takes = [replace(take, same_subject=False, subject=take.name) for take in takes]
    return Task(clip.positions, clip.labels, clip.rate, describe(clip), groups, tuple(takes))


def batch_of(task: Task) -> SegmentBatch:
    return split_into_batches(task.groups[0], task.valid, task.geometry.distance)[0]


def places_of(task: Task, options: SimulatedGapOptions) -> tuple[SimulatedPlaces, np.ndarray]:
    """What simulates the gap of a task, and all rows of its bank."""
    search = PoseSearch(task)
    batch = batch_of(task)
    visible = batch.visible[
        np.argsort(task.geometry.distance[batch.markers].min(axis=0)[batch.visible])
    ]
    root = task.root_among(visible)
    assert root is not None
    needed = np.concatenate([batch.markers, visible])
    bank = search.bank(root, visible[:12], needed, 15.0)
    frames = np.arange(START, STOP)
    query = PoseSamples(
        task.positions[START:STOP, visible],
        np.empty((len(frames), 0, 3)),
        frames / task.rate,
        np.full(len(frames), -1),
    )
    seconds = len(task.positions) / task.rate
    before, after = START / task.rate, seconds - (STOP - 1) / task.rate
    places = SimulatedPlaces(
        bank, root, search, visible, batch.markers, query, before, after, options
    )
    return places, bank.rows


@pytest.fixture(scope="module")
def same_motion() -> tuple[SimulatedPlaces, np.ndarray]:
    """The clip itself, another seed of it, and another motion as takes."""
    others = [person(), person(seed=4), person("squatting")]
    task = task_with_takes(*(replace(one, name=str(i)) for i, one in enumerate(others)))
    return places_of(task, SimulatedGapOptions(places=3))


def test_the_most_alike_stretch_is_found_first(
    same_motion: tuple[SimulatedPlaces, np.ndarray],
) -> None:
    """The same clip as a take has the gap's own frames, at the resolution of the bank."""
    places, rows = same_motion
    first, second = places.find(rows)[:2]
    assert (first.take, second.take) == (0, 1)
    assert first.distance < second.distance
    time = first.gap_rows / places.bank.rates(first.gap_rows)
    assert abs(time[0] - START / 60.0) < 0.1
    assert abs(time[-1] - (STOP - 1) / 60.0) < 0.1


def test_long_takes_are_searched_around_the_poses_near_the_gap(
    same_motion: tuple[SimulatedPlaces, np.ndarray],
) -> None:
    places, rows = same_motion
    found = places.find(rows)[0]
    few = replace(places, options=replace(places.options, searched_poses=40))
    (near, *_) = few.find(found.gap_rows)
    np.testing.assert_array_equal(near.gap_rows, found.gap_rows)
    assert len(near.own_rows) <= 40 - len(near.gap_rows)


def test_own_poses_are_outside_the_simulated_gap(
    same_motion: tuple[SimulatedPlaces, np.ndarray],
) -> None:
    places, rows = same_motion
    for place in places.find(rows):
        assert not np.isin(place.own_rows, place.gap_rows).any()
        assert (places.bank.take(place.own_rows) == place.take).all()
        context = place.context(3)
        assert np.isin(context, place.own_rows).all()
        assert place.gap_rows[0] - 1 in context or place.own_rows[0] > place.gap_rows[0]


def test_the_own_poses_predict_a_simulated_gap(
    same_motion: tuple[SimulatedPlaces, np.ndarray],
) -> None:
    places, rows = same_motion
    place = places.find(rows)[0]
    task = places.search.task
    distance = task.geometry.distance[np.ix_(places.missing, places.visible)].min(axis=0)
    spread = task.geometry.spread[np.ix_(places.missing, places.visible)].min(axis=0)
    models = ModelOptions().simulated_gap[:2]
    for mirror in (None, 0.95):
        own = places.predict_own(place, models, distance, spread, mirror)
        truth = places.bank.positions(place.gap_rows, places.missing)
        still = np.linalg.norm(truth - truth[:1], axis=-1).mean()
        assert np.linalg.norm(own.positions - truth, axis=-1).mean() < 0.5 * still


def test_likeness_falls_with_the_difference_of_the_bodies() -> None:
    options = SimulatedGapOptions()
    offset = np.zeros((4, 5, 3))
    assert options.likeness(offset) == 1.0
    offset[..., 1] = options.body_difference
    assert options.likeness(offset) == pytest.approx(0.5)


def test_the_plan_has_simulated_gaps() -> None:
    """They are training poses of one take each, and the problem of the clip has none."""
    takes = [replace(person(seed=seed), name=str(seed)) for seed in (4, 5, 6)]
    task = task_with_takes(*takes)
    options = GPROptions()
    plan = TrainingPlanner(task, PoseSearch(task), 0, options).plan(batch_of(task), None)
    assert plan is not None
    own, with_database = plan.problems
    assert not own.simulated_gaps
    assert with_database.simulated_gaps
    for gap in with_database.simulated_gaps:
        assert len(np.unique(with_database.train.recording[gap.rows])) == 1
        assert gap.own_residuals.shape == (len(gap.rows), len(ARM), 3)
        assert gap.likeness > 0.5  # the same body, in other poses

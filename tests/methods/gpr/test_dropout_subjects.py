"""Learning from recordings at low rates, and from other recordings of the same subject."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gappy import ARM, person, with_gaps

from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.filling.fill_clip import fill
from priorfill.gaps import gap_groups
from priorfill.gp.problem import RegressionProblem
from priorfill.markers.describe import describe
from priorfill.methods.gpr.blackout.database_windows import DatabaseWindows, similar_windows
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.gap_segments import GapSegment, SegmentBatch
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.training.plan import TrainingPlanner
from priorfill.methods.gpr.training.subject_correlation import take_correlations
from priorfill.methods.task import MIRROR_IMAGE, THIS_CLIP, Task
from priorfill.search.takes import same_subject_take

SLOW = 10.0
"""Hz. Below the rates at which a database is read; people walk with two steps a second."""

DEFAULTS = GPROptions()


def sampled(clip: Clip, rate: float) -> Clip:
    """A clip at a lower rate, with a name of its own."""
    every = round(clip.rate / rate)
    return Clip(clip.positions[::every], clip.labels, clip.rate / every, clip.up, name="slow")


def task_of(clip: Clip, other: Clip) -> Task:
    return Task(
        clip.positions,
        clip.labels,
        clip.rate,
        describe(clip),
        tuple(gap_groups(clip.missing)),
        (same_subject_take(other, clip.labels),),
        clip.name,
    )


def arm_problem(task: Task) -> RegressionProblem:
    """The regression problem of an arm with training poses of the other recording."""
    markers = np.array([task.labels.index(label) for label in ARM])
    start, stop = (int(f) for f in np.flatnonzero(~task.valid[:, markers[0]])[[0, -1]])
    visible = np.setdiff1d(np.arange(len(task.labels)), markers)
    options = GPROptions()
    planner = TrainingPlanner(task, PoseSearch(task, options.search), 8, options)
    plan = planner.plan(SegmentBatch((GapSegment(markers, start, stop + 1, visible),)), None)
    assert plan is not None
    _, with_other = plan.problems
    return with_other


def test_lag_features_of_a_slow_recording_have_the_requested_lag() -> None:
    whole = person(seconds=8.0)
    fast, slow = (
        arm_problem(task_of(with_gaps(whole, (100, 190, ARM)), sampled(person(seconds=12.0), rate)))
        for rate in (60.0, SLOW)
    )
    for seconds, lagged in slow.train.lagged.items():
        ways = [np.diff(x, axis=0)[0] for x in (lagged, fast.train.lagged[seconds])]
        lengths = [
            np.sqrt((way[problem.train.recording >= 0] ** 2).mean())
            for way, problem in zip(ways, (slow, fast), strict=True)
        ]
        # interpolation between frames shortens it a little
        assert lengths[0] == pytest.approx(lengths[1], rel=0.2), seconds
    time = slow.train.time[slow.train.recording >= 0]
    steps = (time - time.min()) * SLOW
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


def test_velocities_are_those_of_clip_mirror_image_and_other_recording() -> None:
    whole, other = person(seconds=8.0), person(seconds=8.0, seed=9)
    train = arm_problem(task_of(with_gaps(whole, (100, 190, ARM)), other)).train
    assert train.velocity is not None and not np.isnan(train.velocity).any()
    markers = [whole.labels.index(label) for label in ARM]
    opposite = [describe(whole).mirror[label] for label in ARM]
    contralateral = [whole.labels.index(label) for label in opposite]
    step = 2  # of 60 Hz: 1/30 s
    away = []
    for pose, recording in enumerate(train.recording):
        source, wanted = (other if recording >= 0 else whole), train.missing[pose].copy()
        columns, sign = markers, np.ones(3)
        if recording == MIRROR_IMAGE:
            columns, sign = contralateral, np.array([-1.0, 1.0, 1.0])
        shown = source.positions[:, columns] * sign
        frame = int(np.argmin(np.abs(shown - wanted).max(axis=(1, 2))))
        if not step <= frame < len(shown) - step:
            continue
        moved = shown[frame + step] - shown[frame - step]
        in_gap = np.isin([frame - step, frame + step], range(100, 190)).any()
        if recording == THIS_CLIP and in_gap:
            continue  # at the edges of the gap they are one-sided differences
        away.append(np.linalg.norm(train.velocity[pose] - moved * 60 / (2 * step), axis=1).max())
        if recording < 0:
            assert away[-1] < 1e-6
    speed = np.linalg.norm(train.velocity, axis=2).max(axis=1)
    # the other recording is interpolated linearly at 15 Hz
    assert np.mean(away) < 0.2 * speed.mean()


def within(distance: float) -> GPROptions:
    """Options for windows of the database with edges up to a distance (mm) away."""
    return GPROptions(blackout=BlackoutOptions(max_edge_distance=distance))


def windows_for(
    task: Task, start: int, stop: int, options: GPROptions = DEFAULTS
) -> tuple[list[DatabaseWindows], tuple[str, ...]]:
    search = PoseSearch(task, options.search)
    correlation = take_correlations(task.takes, search.subjects, options.correlation)
    return similar_windows(task, search, options.blackout, correlation, task.positions, start, stop)


def test_windows_of_a_slow_recording_have_the_clips_rate() -> None:
    whole, start, stop = person(seconds=8.0), 199, 234  # at frames of the other recording
    clip = with_gaps(whole, (start, stop, whole.labels))
    task = task_of(clip, sampled(whole, SLOW))
    found, takes = windows_for(task, start, stop)
    assert takes == ("slow",)
    inside = found[0].positions(np.arange(stop - start), np.arange(len(whole.labels)))[0]
    truth = whole.positions[start:stop]
    # the other recording is the clip itself, so the most similar window is the blackout
    away = np.linalg.norm(inside - truth, axis=2)
    assert away.mean() < 0.2 * np.linalg.norm(truth - truth[0], axis=2).mean()


def test_another_recording_of_the_subject_is_a_recording_of_its_own() -> None:
    clip = with_gaps(person(seconds=8.0), (100, 190, ARM))
    task = task_of(clip, person(seconds=8.0, seed=9))
    problem = arm_problem(task)
    train = problem.train
    assert train.subject is not None and train.correlation is not None
    same_subject = train.recording >= 0
    assert same_subject.any()
    assert set(train.subject[same_subject]) == {THIS_CLIP}
    assert set(train.correlation[same_subject]) == {1.0}
    # only blocks of the clip are held out
    blocks = np.concatenate(train.blocks(1.5, problem.query))
    assert set(train.recording[blocks]) == {THIS_CLIP}
    # its poses are as recorded, without offsets of the markers
    take = task.takes[0]
    recorded = take.positions(take.nearest_level(15.0))
    for pose in train.visible[same_subject][:5]:
        assert np.abs(recorded - pose[0]).max(axis=2).min() < 1e-2


def test_windows_of_another_recording_of_the_subject_are_fully_correlated() -> None:
    clip = with_gaps(person(seconds=8.0), (200, 236, person().labels))
    task = task_of(clip, person(seconds=8.0, seed=9))
    found, _ = windows_for(task, 200, 236)
    assert found
    assert {value for windows in found for value in windows.correlation} == {1.0}
    # walks of other phases are farther away
    nearer, _ = windows_for(task, 200, 236, within(60.0))
    assert sum(len(one.rows) for one in nearer) < sum(len(one.rows) for one in found)
    assert windows_for(task, 200, 236, within(1.0)) == ([], ())


@pytest.mark.parametrize("labels", [ARM, person().labels])
def test_other_recordings_are_named_as_sources(labels: tuple[str, ...], tmp_path: Path) -> None:
    other = replace(person(seconds=6.0, rate=30.0, seed=9), name="other")
    clip = with_gaps(person(seconds=2.5, rate=30.0), (25, 47, labels))
    with PriorDatabase.create(tmp_path / "db") as made:
        made.add(person(seconds=6.0, seed=11, body=11))
    for given, expected in (
        ({"same_subject": [other]}, " and other clips of the same subject"),
        ({"database": tmp_path / "db"}, " and the database"),
        (
            {"same_subject": [other], "database": tmp_path / "db"},
            ", other clips of the same subject and the database",
        ),
    ):
        gap = fill(clip, **given).gaps[0]
        assert gap.sources[0].removesuffix("'s").endswith(expected), gap
        assert ("other" in gap.source_clips) == ("same_subject" in given)

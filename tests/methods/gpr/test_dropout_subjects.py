"""What a clip learns from recordings at low rates, and from other clips of the same person."""

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
from priorfill.gp.data import Lesson
from priorfill.markers.describe import describe
from priorfill.methods.gpr.blackout.database_windows import similar_movements
from priorfill.methods.gpr.gap_segments import Piece
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.training.plan import Lessons
from priorfill.methods.task import Task
from priorfill.search.takes import same_subject_take

SLOW = 10.0
"""Hz. Below what is asked for; people walk with two steps a second."""


def sampled(clip: Clip, rate: float) -> Clip:
    """Every so many frames of a clip, which has a name of its own."""
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


def limb_lesson(task: Task) -> Lesson:
    """The lesson of an arm that the other recording has a part in."""
    markers = np.array([task.labels.index(label) for label in ARM])
    start, stop = (int(f) for f in np.flatnonzero(~task.valid[:, markers[0]])[[0, -1]])
    visible = np.setdiff1d(np.arange(len(task.labels)), markers)
    options = GPROptions()
    lessons = Lessons(task, PoseSearch(task, options), 8, options)
    course = lessons.of(Piece(markers, start, stop + 1, visible), None)
    assert course is not None
    _, shared = course.lessons
    return shared


def test_moments_of_a_slow_recording_are_as_long_as_asked_for() -> None:
    whole = person(seconds=8.0)
    fast, slow = (
        limb_lesson(task_of(with_gaps(whole, (100, 190, ARM)), sampled(person(seconds=12.0), rate)))
        for rate in (60.0, SLOW)
    )
    for seconds, around in slow.rows.around.items():
        ways = [np.diff(x, axis=0)[0] for x in (around, fast.rows.around[seconds])]
        lengths = [
            np.sqrt((way[lesson.rows.take > 1] ** 2).mean())
            for way, lesson in zip(ways, (slow, fast), strict=True)
        ]
        # between frames some of it is lost
        assert lengths[0] == pytest.approx(lengths[1], rel=0.2), seconds
    time = slow.rows.time[slow.rows.take > 1]
    steps = (time - time.min()) * SLOW
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


def test_velocities_are_those_of_clip_mirror_image_and_companion() -> None:
    whole, other = person(seconds=8.0), person(seconds=8.0, seed=9)
    lesson = limb_lesson(task_of(with_gaps(whole, (100, 190, ARM)), other))
    rows = lesson.rows
    assert rows.moving is not None and not np.isnan(rows.moving).any()
    markers = [whole.labels.index(label) for label in ARM]
    opposite = [describe(whole).mirror[label] for label in ARM]
    partners = [whole.labels.index(label) for label in opposite]
    step = 2  # of 60 Hz: 1/30 s
    away = []
    for row in range(len(rows.time)):
        source, wanted = (other if rows.take[row] > 1 else whole), rows.missing[row].copy()
        columns, sign = (markers, 1.0) if rows.take[row] != 1 else (partners, [-1.0, 1.0, 1.0])
        shown = source.positions[:, columns] * sign
        frame = int(np.argmin(np.abs(shown - wanted).max(axis=(1, 2))))
        if not step <= frame < len(shown) - step:
            continue
        moved = shown[frame + step] - shown[frame - step]
        if rows.take[row] == 0 and np.isin([frame - step, frame + step], range(100, 190)).any():
            continue  # right beside the gap they are those of one side
        away.append(np.linalg.norm(rows.moving[row] - moved * 60 / (2 * step), axis=1).max())
        if rows.take[row] <= 1:
            assert away[-1] < 1e-6
    speed = np.linalg.norm(rows.moving, axis=2).max(axis=1)
    # at 15 Hz the other one's are those of straight lines
    assert np.mean(away) < 0.2 * speed.mean()


def test_movements_of_a_slow_recording_are_as_fast_as_they_were() -> None:
    whole, start, stop = person(seconds=8.0), 199, 234  # edges that the other shows too
    clip = with_gaps(whole, (start, stop, whole.labels))
    task = task_of(clip, sampled(whole, SLOW))
    options = GPROptions()
    found, takes = similar_movements(
        task, PoseSearch(task, options), options, clip.positions, start, stop
    )
    assert takes == ("slow",)
    best = found[0]
    assert best.starts is not None
    inside = best.positions[best.starts[0] : best.starts[0] + stop - start]
    truth = whole.positions[start:stop]
    # the other recording is the clip itself, and nothing is more like it
    away = np.linalg.norm(inside - truth, axis=2)
    assert away.mean() < 0.2 * np.linalg.norm(truth - truth[0], axis=2).mean()


def test_a_companion_is_of_the_clips_own_body_but_another_take() -> None:
    clip = with_gaps(person(seconds=8.0), (100, 190, ARM))
    task = task_of(clip, person(seconds=8.0, seed=9))
    lesson = limb_lesson(task)
    rows = lesson.rows
    assert rows.body is not None and rows.kinship is not None
    same_subject = rows.take > 1
    assert same_subject.any()
    assert set(rows.body[same_subject]) == set(lesson.query.take)
    assert set(rows.kinship[same_subject]) == {1.0}
    # it is never left out with the clip's blocks, nor judged as if it were the clip
    blocks = np.concatenate(rows.blocks(1.5, lesson.query))
    assert set(rows.take[blocks]) == set(lesson.query.take)
    # its poses are as recorded: no marker sits elsewhere on the same body
    take = task.takes[0]
    recorded = take.positions(take.nearest_level(15.0))
    for pose in rows.visible[same_subject][:5]:
        assert np.abs(recorded - pose[0]).max(axis=2).min() < 1e-2


def test_movements_of_a_companion_are_of_the_clips_own_body() -> None:
    clip = with_gaps(person(seconds=8.0), (200, 236, person().labels))
    task = task_of(clip, person(seconds=8.0, seed=9))
    options = GPROptions()
    found, _ = similar_movements(task, PoseSearch(task, options), options, clip.positions, 200, 236)
    assert found
    assert {recording.kinship for recording in found} == {1.0}


@pytest.mark.parametrize("labels", [ARM, person().labels])
def test_what_is_told_by_companions_is_said(labels: tuple[str, ...], tmp_path: Path) -> None:
    other = replace(person(seconds=6.0, rate=30.0, seed=9), name="other")
    clip = with_gaps(person(seconds=2.5, rate=30.0), (25, 47, labels))
    with PriorDatabase.create(tmp_path / "db") as made:
        made.add(person(seconds=6.0, seed=11, body=11))
    for given, said in (
        ({"same_subject": [other]}, " and other clips of the same person"),
        ({"database": tmp_path / "db"}, " and the database"),
        (
            {"same_subject": [other], "database": tmp_path / "db"},
            ", other clips of the same person and the database",
        ),
    ):
        gap = fill(clip, **given).gaps[0]
        assert gap.sources[0].removesuffix("'s").endswith(said), gap
        assert ("other" in gap.source_clips) == ("same_subject" in given)

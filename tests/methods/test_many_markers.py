"""Clips of very many markers are filled neighbourhood by neighbourhood, at linear cost."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from gappy import error, person

from priorfill.artefacts import find_artefacts
from priorfill.clip import Clip
from priorfill.errors import MethodError
from priorfill.filling.fill_clip import fill
from priorfill.gaps import gap_groups
from priorfill.geometry.neighbourhoods import MAX_DENSE_MARKERS
from priorfill.markers.definitions import recognise
from priorfill.markers.describe import describe
from priorfill.methods import get_method
from priorfill.methods.many_markers import by_neighbourhoods
from priorfill.methods.task import Task, no_progress
from priorfill.methods.task_parts import part_of_task, wanted_samples


@cache
def crowd(motion: str = "walking", people: int = 8, frames: int = 60) -> Clip:
    """People who walk side by side, 2 m apart, in one clip: 41 markers each."""
    clips = [person(motion, body=number, seconds=2.0) for number in range(people)]
    aside = 2000.0 * np.eye(3)[1]
    positions = [clip.positions[:frames] + n * aside for n, clip in enumerate(clips)]
    labels = tuple(f"{n}_{label}" for n, clip in enumerate(clips) for label in clip.labels)
    return Clip(np.concatenate(positions, axis=1), labels, 60.0, name="crowd")


GAPS = ((20, 30, 5), (25, 40, 100), (25, 40, 101), (10, 15, 300), (50, 60, 30))


def gappy() -> Clip:
    """The crowd with a few gaps."""
    clip = crowd()
    positions = clip.positions.copy()
    for start, stop, marker in GAPS:
        positions[start:stop, marker] = np.nan
    return clip.with_positions(positions)


def task_of(clip: Clip) -> Task:
    """The task to fill all gaps of a clip."""
    groups = tuple(gap_groups(clip.missing))
    return Task(clip.positions, clip.labels, clip.rate, describe(clip), groups, (), clip.name)


def test_the_gaps_of_a_crowd_are_filled_as_those_of_one_person():
    assert len(crowd().labels) > MAX_DENSE_MARKERS
    clip = gappy()
    result = fill(clip)
    assert result.complete
    assert error(result.clip.positions, crowd().positions, clip.missing) < 6.0
    measured = ~clip.missing
    np.testing.assert_array_equal(result.clip.positions[measured], clip.positions[measured])
    assert np.isfinite(result.error_bound_90_mm[clip.missing]).all()
    assert {gap.sources for gap in result.gaps} == {("the clip's own frames",)}


def test_a_recording_of_the_same_subject_is_divided_too():
    marker = crowd().labels.index("0_C7")
    positions = crowd().positions.copy()
    positions[:, marker] = np.nan
    other = replace(crowd("squatting"), name="squats")
    result = fill(crowd().with_positions(positions), same_subject=[other])
    assert result.filled[:, marker].all()
    assert error(result.clip.positions, crowd().positions, result.filled) < 20.0
    assert "other recordings of the same subject" in result.gaps[0].sources[0]


def test_progress_counts_the_samples_of_the_clip():
    counted = []
    task = task_of(gappy())
    estimate = by_neighbourhoods(get_method("linear"))(task, counted.append)
    assert sum(counted) == task.samples
    assert estimate.error_bound_90 is None
    assert {note.marker for note in estimate.notes} == {marker for _, _, marker in GAPS}


def test_where_a_method_cannot_work_on_a_part_the_others_are_filled():
    def method(task, progress):
        if any(label.startswith("0_") for label in task.labels):
            raise MethodError("crowd: is no good; use another method")
        return get_method("rigid")(task, progress)

    task = task_of(gappy())
    estimate = by_neighbourhoods(method)(task, no_progress)
    refused = [note for note in estimate.notes if note.source == "is no good; use another method"]
    assert {note.marker for note in refused} == {5, 30}
    assert not any(note.filled for note in refused)

    def never(task, progress):
        raise MethodError("crowd: is no good; use another method")

    with pytest.raises(MethodError, match=r"^crowd: is no good"):
        by_neighbourhoods(never)(task, no_progress)


def test_a_part_sees_the_earlier_fill_of_its_markers():
    clip = gappy()
    task = replace(task_of(clip), completed=crowd().positions)
    columns = np.array([4, 5, 100])
    part = part_of_task(task, columns[:1], columns, wanted_samples(task))
    assert part.completed is not None
    np.testing.assert_array_equal(part.completed, crowd().positions[:, columns])
    assert part_of_task(task_of(clip), columns, columns, clip.missing).completed is None


def test_a_marker_set_is_found_part_by_part():
    found = describe(crowd())
    assert found.labels == crowd().labels
    assert set(found.segment) == set(crowd().labels)
    numbers = [int(name.removeprefix("segment")) for name in found.segments]
    assert numbers == list(range(1, len(numbers) + 1))
    people = [{label[:2] for label in markers} for markers in found.segments.values()]
    assert np.mean([len(of) == 1 for of in people]) > 0.9
    assert set(found.root_segments) <= set(found.segments)


def test_a_known_marker_set_among_many_other_points():
    known = person(seconds=1.0)
    others = np.random.default_rng(0).normal(3000.0, 500.0, (60, 300, 3))
    labels = (*known.labels, *(f"*{i}" for i in range(300)))
    clip = Clip(np.concatenate([known.positions, others], axis=1), labels, 60.0)
    found = describe(clip, recognise(known.labels))
    assert found.name == "baumann41"
    assert found.segment["*7"] == "*7"
    assert not found.reliable["*7"]


def test_artefacts_are_found_part_by_part():
    positions = crowd().positions.copy()
    positions[30:32, 200, 2] += 150.0
    [spike] = find_artefacts(crowd().with_positions(positions))
    assert spike.markers == (crowd().labels[200],)
    assert (spike.start, spike.stop) == (30, 32)


def test_memory_is_linear_in_the_markers():
    """All pairs of 700 markers would be 3.9 MB for each quantity."""

    def scattered(markers: int) -> Clip:
        positions = np.random.default_rng(0).normal(0.0, 900.0, (6, markers, 3))
        positions[2:4, 17] = np.nan
        return Clip(positions, tuple(f"P{i}" for i in range(markers)), 100.0)

    fill(scattered(MAX_DENSE_MARKERS + 1))  # imports
    clip = scattered(700)
    tracemalloc.start()
    find_artefacts(clip)
    fill(clip)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3.9e6

"""The number of neighbours, chosen by leaving takes out of the database."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gappy import fill_unchecked, person, with_gaps
from random_bodies import body, task_of

from priorfill.errors import OptionError
from priorfill.methods.baumann2011 import neighbour_votes
from priorfill.methods.baumann2011.neighbour_count import (
    COUNTS,
    UNKNOWN_COUNT,
    choose_neighbours,
)
from priorfill.methods.baumann2011.neighbour_votes import Baumann2011Options
from priorfill.methods.baumann2011.pose_searches import SearchPlanner
from priorfill.methods.options import with_values
from priorfill.methods.task import Task


def gappy_body() -> np.ndarray:
    gappy = body(0, 24)
    gappy[5:15, 8] = np.nan
    return gappy


def chosen(task: Task) -> tuple[int, dict[int, float]]:
    """The choice, and the error of each number by refits without the probes' takes."""
    planner = SearchPlanner(task, task.takes)
    (search,) = planner.plan(task.valid[5], (8,)).searches
    bank = planner.bank(search, task.rate)
    frames = task.positions[5:15]
    _, nearest = bank.search(frames, search.root.frames(frames), 1)
    off: dict[int, list[float]] = {}
    poses = bank.local(bank.rows, search.viable)
    for probe in np.unique(nearest):
        others = bank.rows[bank.take(bank.rows) != bank.take(np.array([probe]))]
        pose = poses[bank.rows == probe]
        distance = ((poses[np.isin(bank.rows, others)] - pose) ** 2).sum(axis=(1, 2))
        order = others[np.argsort(distance, kind="stable")]
        truth = bank.wanted(np.array([probe]))[0]
        for k in COUNTS:
            mean = bank.wanted(order[:k]).mean(axis=0)
            off.setdefault(k, []).append(float(np.linalg.norm(mean - truth, axis=1).mean()))
    errors = {k: float(np.mean(values)) for k, values in off.items()}
    count = choose_neighbours(bank, search, frames)
    square = np.mean(np.square(off[count.k]))  # one marker is missing
    np.testing.assert_allclose(count.rms, np.sqrt(square), rtol=1e-4)
    return count.k, errors


def alike(seed: int, frames: int, noise: float) -> np.ndarray:
    """A body that repeats the poses of `body(0)`, with noise in the marker that is missing."""
    source = body(0, 24)[np.arange(frames) % 24]
    source[:, 8] += noise * np.random.default_rng(seed).normal(size=(frames, 3))
    return source


def test_the_number_with_the_least_error_in_other_takes_is_chosen():
    others = [body(seed, 60) for seed in range(1, 5)]
    count, errors = chosen(task_of(gappy_body(), others, set(range(8))))
    assert count == min(errors, key=errors.__getitem__)


def test_many_poses_alike_need_many_neighbours_and_few_need_few():
    noisy = [alike(seed, 24 * 8, 60.0) for seed in range(1, 5)]
    many, _ = chosen(task_of(gappy_body(), noisy, set(range(8))))
    exact = [alike(seed, 26, 0.5) for seed in range(1, 5)]
    few, _ = chosen(task_of(gappy_body(), exact, set(range(8))))
    assert many >= 8
    assert few <= 4


def test_one_take_is_left_out_around_the_probe():
    """The clip itself: poses nearer in time than the gap is long do not count."""
    counts = []
    for frames in (24 * 6, 12):
        task = task_of(gappy_body(), [alike(1, frames, 0.5)], set(range(8)))
        planner = SearchPlanner(task, task.takes, min_poses=1)
        (search,) = planner.plan(task.valid[5], (8,)).searches
        bank = planner.bank(search, task.rate)
        counts.append(choose_neighbours(bank, search, task.positions[5:15]).k)
    assert counts[0] in (1, 2, 4)  # five repetitions are left
    assert counts[1] == UNKNOWN_COUNT


def test_a_number_of_the_user_is_kept():
    task = task_of(gappy_body(), [body(seed, 60) for seed in range(1, 5)], set(range(8)))
    for options, poses in ((Baumann2011Options(neighbours=7), {7}), (None, set(COUNTS))):
        found = neighbour_votes.fill(task, options=options)
        assert {note.training_poses for note in found.notes} <= poses
    options = with_values(Baumann2011Options(neighbours=7), {"neighbours": "none"})
    assert options == Baumann2011Options()
    with pytest.raises(OptionError, match="neighbours is 0"):
        Baumann2011Options(neighbours=0)


def test_the_note_states_the_number():
    clip = replace(person(), subject="")
    result = fill_unchecked(with_gaps(clip, (100, 130, ("LKNE",))), method="baumann2011")
    (gap,) = result.gaps
    assert gap.sources[0].startswith(f"{gap.training_poses} nearest poses by ")
    assert gap.training_poses in COUNTS


def test_the_expected_error_is_at_least_that_in_other_takes():
    task = task_of(gappy_body(), [alike(seed, 26, 60.0) for seed in range(1, 5)], set(range(8)))
    count, errors = chosen(task)
    alone = neighbour_votes.fill(task, options=Baumann2011Options(neighbours=count))
    found = neighbour_votes.fill(task)
    np.testing.assert_array_equal(found.positions, alone.positions)
    assert (found.expected_rms >= alone.expected_rms)[5:15, 8].all()
    assert (found.expected_rms[5:15, 8] >= 0.9 * errors[count]).all()

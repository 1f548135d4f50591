"""What keeps fills linear in gaps and markers gives what the plain way gives."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.filling.assemble import _overlapping
from priorfill.filling.held_out_errors import _Shifts
from priorfill.filling.plausibility import MAX_SAMPLED, PlausibilityCheck
from priorfill.filling.plausibility_options import PlausibilityOptions
from priorfill.gaps import Gap, find_gaps, gap_groups
from priorfill.geometry.distances import norms
from priorfill.markers.clip_geometry import ClipGeometry
from priorfill.methods.task import Task


def random_task(seed: int) -> Task:
    """A task with gaps, some of them in groups."""
    rng = np.random.default_rng(seed)
    positions = rng.normal(0.0, 400.0, (int(rng.integers(4, 60)), 4, 3))
    mask = rng.random(positions.shape[:2]) < 0.15
    positions[mask] = np.nan
    labels = ("A", "B", "C", "D")
    geometry = ClipGeometry(positions, labels)
    return Task(positions, labels, 100.0, geometry.marker_set, tuple(gap_groups(mask)))


def plain_shift(free, gaps, number):
    """The best shift, and the gaps that fit there, tried one after the other."""
    frames = len(free)
    best, fitting_best, best_score = 0, set(), (0, False, 0)
    for shift in range(1 - frames, frames):
        fitting = [
            gap
            for gap in gaps
            if gap.start + shift > 0
            and gap.stop + shift < frames
            and free[gap.start + shift - 1 : gap.stop + shift + 1, gap.marker].all()
        ]
        samples = sum(gap.frames for gap in fitting)
        score = (samples, (shift > 0) == (number % 2 == 0), -abs(shift))
        if samples and score > best_score:
            best, fitting_best, best_score = shift, set(fitting), score
    return best, fitting_best


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), number=st.integers(0, 1))
def test_copies_of_gaps_are_shifted_to_where_most_fit(seed, number):
    task = random_task(seed)
    used = np.random.default_rng(seed).random(task.valid.shape) < 0.05
    for group in task.groups:
        rest = [gap for gap in group.gaps if gap.start > 0 and gap.stop < len(used)]
        shifts = _Shifts(task, used, rest)
        placed = set(rest)
        while rest and placed:
            shift, placed = plain_shift(task.valid & ~used, rest, number)
            assert shifts.best(number) == shift
            assert not placed or shifts.fitting(rest, shift) == placed
            left = [gap for gap in rest if gap not in placed]
            shifts.place(rest, left, shift)
            assert all(
                used[gap.start + shift : gap.stop + shift, gap.marker].all() for gap in placed
            )
            rest = left


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6))
def test_neighbours_are_those_of_all_markers(seed):
    geometry = random_task(seed).geometry
    check = PlausibilityCheck(geometry, 100.0, PlausibilityOptions(neighbour_distance=700.0))
    sample = geometry.positions[:: max(1, len(geometry.positions) // MAX_SAMPLED)]
    for marker in range(4):
        apart = norms(sample - sample[:, marker : marker + 1])
        near = [
            other
            for other in range(4)
            if other != marker
            and not np.isnan(apart[:, other]).all()
            and np.nanmean(apart[:, other]) < 700.0
        ]
        assert check._neighbours(marker).tolist() == near


@given(seed=st.integers(0, 10**6), start=st.integers(0, 59), frames=st.integers(1, 20))
def test_overlapping_gaps(seed, start, frames):
    mask = np.random.default_rng(seed).random((60, 1)) < 0.4
    gaps = find_gaps(mask)
    expected = [gap for gap in gaps if gap.start < start + frames and gap.stop > start]
    assert list(_overlapping(gaps, start, start + frames)) == expected


def test_many_gaps_of_one_group():
    mask = np.ones((9, 2), dtype=bool)
    mask[::2, 0] = False
    mask[[0, 8], 1] = False
    [group] = gap_groups(mask)
    assert group.gaps[0] == Gap(1, 2, 0)
    assert len(group.gaps) == 5

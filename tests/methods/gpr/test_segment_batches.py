"""Gap segments, and which of them share a regression."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from priorfill.gaps import gap_groups
from priorfill.methods.gpr.gap_segments import MIN_VISIBLE
from priorfill.methods.gpr.segment_batches import (
    SegmentOptions,
    plan_batches,
    split_into_batches,
)


def split_into_segments(group, valid, distance):
    """The segments of all batches of a group."""
    batches = split_into_batches(group, valid, distance)
    segments = [segment for batch in batches for segment in batch.segments]
    return sorted(segments, key=lambda segment: (segment.start, segment.markers[0]))


@st.composite
def patterns(draw):
    """Which samples are measured, in runs and in single frames, and distances of markers."""
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    frames, markers = draw(st.integers(1, 60)), draw(st.integers(1, 9))
    valid = np.ones((frames, markers), dtype=bool)
    for _ in range(draw(st.integers(1, 12))):
        start, stop = np.sort(rng.integers(0, frames + 1, 2))
        some = rng.random(markers) < rng.random()
        valid[start:stop, some] = False
    valid &= rng.random(valid.shape) > draw(st.sampled_from([0.0, 0.02, 0.5]))
    points = rng.normal(0, 300, (markers, 3))
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    never = rng.random(distance.shape) < draw(st.sampled_from([0.0, 0.3]))
    distance[never | never.T] = np.inf
    np.fill_diagonal(distance, 0.0)
    return valid, distance


@settings(deadline=None, max_examples=40)
@given(patterns())
def test_segments_cover_each_missing_sample_once(pattern):
    valid, distance = pattern
    count = np.zeros(valid.shape, dtype=int)
    for group in gap_groups(~valid):
        segments = split_into_segments(group, valid, distance)
        assert [p.start for p in segments] == sorted(p.start for p in segments)
        for segment in segments:
            assert group.start <= segment.start < segment.stop <= group.stop
            assert set(segment.markers) <= set(group.markers)
            count[segment.start : segment.stop, segment.markers] += 1
            assert valid[segment.start : segment.stop][:, segment.visible].all()
            assert not set(segment.visible) & set(segment.markers)
            assert segment.has_enough_visible == (len(segment.visible) >= MIN_VISIBLE)
    np.testing.assert_array_equal(count, (~valid).astype(int))


@settings(deadline=None, max_examples=40)
@given(patterns())
def test_only_near_markers_are_joined(pattern):
    valid, distance = pattern
    for group in gap_groups(~valid):
        for segment in split_into_segments(group, valid, distance):
            near = (
                distance[np.ix_(segment.markers, segment.markers)] <= SegmentOptions.joint_distance
            )
            assert connected_components(near)[0] == 1


@settings(deadline=None, max_examples=50)
@given(patterns())
def test_segments_of_a_group_do_not_depend_on_the_rest_of_the_clip(pattern):
    valid, distance = pattern
    before = gap_groups(~valid)
    longer = np.concatenate([np.ones((5, valid.shape[1]), dtype=bool), valid])
    for group, moved in zip(before, gap_groups(~longer), strict=True):
        here, there = (
            split_into_segments(group, valid, distance),
            split_into_segments(moved, longer, distance),
        )
        assert [(p.start + 5, p.stop + 5, *p.markers) for p in here] == [
            (p.start, p.stop, *p.markers) for p in there
        ]


def near_and_far(markers):
    """Markers 100 mm apart in a row."""
    place = 100.0 * np.arange(markers)
    return np.abs(place[:, None] - place)


def test_a_gap_is_divided_where_a_near_marker_is_lost_but_not_a_far_one():
    valid = np.ones((100, 12), dtype=bool)
    valid[20:80, 0] = False
    valid[40:60, 11] = False
    group = gap_groups(~valid)[0]
    mine = [p for p in split_into_segments(group, valid, near_and_far(12)) if p.markers[0] == 0]
    assert [(p.start, p.stop) for p in mine] == [(20, 80)]
    assert 11 not in mine[0].visible
    valid[40:60, 11] = True
    valid[40:60, 1] = False
    group = gap_groups(~valid)[0]
    mine = [p for p in split_into_segments(group, valid, near_and_far(12)) if p.markers[0] == 0]
    assert [(p.start, p.stop) for p in mine] == [(20, 40), (40, 60), (60, 80)]


@pytest.mark.parametrize(
    ("visible", "expected"),
    [(MIN_VISIBLE, [(20, 40), (40, 60), (60, 80)]), (MIN_VISIBLE + 1, [(20, 80)])],
)
def test_a_gap_is_divided_where_a_far_marker_is_needed_for_a_frame(visible, expected):
    place = np.append(100.0 * np.arange(visible), 2000.0)
    valid = np.ones((100, visible + 1), dtype=bool)
    valid[20:80, 0] = False
    valid[40:60, -1] = False
    segments = split_into_segments(gap_groups(~valid)[0], valid, np.abs(place[:, None] - place))
    assert [(p.start, p.stop) for p in segments if p.markers[0] == 0] == expected


@settings(deadline=None, max_examples=40)
@given(patterns())
def test_batches_of_all_groups_cover_each_missing_sample_once(pattern):
    valid, distance = pattern
    count = np.zeros(valid.shape, dtype=int)
    for batch in plan_batches(gap_groups(~valid), valid, distance):
        lengths = []
        stop = -1
        for segment in batch.segments:
            assert stop < segment.start
            stop = segment.stop
            np.testing.assert_array_equal(segment.markers, batch.markers)
            np.testing.assert_array_equal(segment.visible, batch.visible)
            assert valid[segment.start : segment.stop][:, segment.visible].all()
            count[segment.start : segment.stop, segment.markers] += 1
            lengths.append(segment.stop - segment.start)
        assert min(lengths) <= batch.frames <= max(lengths)
        assert batch.frames <= batch.gap_frames <= len(valid)
    np.testing.assert_array_equal(count, (~valid).astype(int))


def test_a_flickering_near_marker_makes_two_batches():
    """One with it and one without it, however often it appears."""
    valid = np.ones((700, 12), dtype=bool)
    valid[50:650, 0] = False
    for start in range(70, 600, 30):
        valid[start : start + 10, 1] = False
    (group,) = gap_groups(~valid)
    batches = split_into_batches(group, valid, near_and_far(12))
    mine = sorted((b for b in batches if b.markers[0] == 0), key=lambda b: len(b.segments))
    assert [(len(batch.segments), 1 in batch.visible) for batch in mine] == [
        (18, False),
        (19, True),
    ]
    assert [(batch.frames, batch.gap_frames) for batch in mine] == [(10, 600), (20, 600)]


@pytest.mark.parametrize(("flickering", "expected"), [(2, 3), (6, 4)])
def test_a_gap_with_many_sets_of_visible_markers_loses_more_of_them(
    flickering: int, expected: int
) -> None:
    """Two of ten equally near markers are more than a tenth, but less than 0.3."""
    distance = np.full((11, 11), 100.0)
    np.fill_diagonal(distance, 0.0)
    valid = np.ones((200, 11), dtype=bool)
    valid[20:180, 0] = False
    for marker in range(1, 1 + flickering):
        valid[20 + 20 * marker : 40 + 20 * marker, [marker, 10]] = False
    options = SegmentOptions(joint_distance=10.0)
    groups = gap_groups(~valid)
    batches = [b for g in groups for b in split_into_batches(g, valid, distance, options)]
    assert len([b for b in batches if b.markers[0] == 0]) == expected


def test_gaps_of_a_marker_of_similar_length_are_one_batch():
    valid = np.ones((1500, 12), dtype=bool)
    lengths = (10, 11, 19, 21, 45, 300)
    for place, length in zip(range(50, 1500, 200), lengths, strict=False):
        valid[place : place + length, 3] = False
    batches = plan_batches(gap_groups(~valid), valid, near_and_far(12))
    assert [[s.stop - s.start for s in batch.segments] for batch in batches] == [
        [10, 11, 19],
        [21],
        [45],
        [300],
    ]
    assert [batch.frames for batch in batches] == [11, 21, 45, 300]


def test_a_batch_has_a_limited_number_of_gaps():
    valid = np.ones((200, 6), dtype=bool)
    valid[20:180:2, 0] = False
    batches = plan_batches(gap_groups(~valid), valid, near_and_far(6))
    assert [len(batch.segments) for batch in batches] == [SegmentOptions.max_gaps] * 5


def test_flickering_markers_do_not_make_many_batches():
    rng = np.random.default_rng(0)
    valid = rng.random((400, 30)) > 0.05
    valid[50:350, 0] = False
    batches = [
        batch
        for group in gap_groups(~valid)
        for batch in split_into_batches(group, valid, near_and_far(30))
    ]
    mine = [b for b in batches if 0 in b.markers and 50 <= b.segments[0].start < 350]
    assert sum(p.stop - p.start for batch in mine for p in batch.segments) == 300
    assert len(mine) <= 24

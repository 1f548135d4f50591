import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from priorfill.gaps import gap_groups
from priorfill.methods.gpr.gap_segments import (
    FEWEST_VISIBLE,
    JOINT_DISTANCE,
    MAX_PIECES,
    pieces_of,
)


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


@settings(deadline=None, max_examples=100)
@given(patterns())
def test_pieces_cover_what_is_missing_once_and_see_what_they_say(pattern):
    valid, distance = pattern
    count = np.zeros(valid.shape, dtype=int)
    for group in gap_groups(~valid):
        pieces = pieces_of(group, valid, distance)
        assert [p.start for p in pieces] == sorted(p.start for p in pieces)
        for piece in pieces:
            assert group.start <= piece.start < piece.stop <= group.stop
            assert set(piece.markers) <= set(group.markers)
            count[piece.start : piece.stop, piece.markers] += 1
            assert valid[piece.start : piece.stop][:, piece.visible].all()
            assert not set(piece.visible) & set(piece.markers)
            assert piece.searchable == (len(piece.visible) >= FEWEST_VISIBLE)
    np.testing.assert_array_equal(count, (~valid).astype(int))


@settings(deadline=None, max_examples=100)
@given(patterns())
def test_markers_are_joint_only_where_near(pattern):
    valid, distance = pattern
    for group in gap_groups(~valid):
        for piece in pieces_of(group, valid, distance):
            near = distance[np.ix_(piece.markers, piece.markers)] <= JOINT_DISTANCE
            assert connected_components(near)[0] == 1


@settings(deadline=None, max_examples=50)
@given(patterns())
def test_pieces_of_a_group_know_nothing_of_the_rest_of_the_clip(pattern):
    valid, distance = pattern
    before = gap_groups(~valid)
    longer = np.concatenate([np.ones((5, valid.shape[1]), dtype=bool), valid])
    for group, moved in zip(before, gap_groups(~longer), strict=True):
        here, there = pieces_of(group, valid, distance), pieces_of(moved, longer, distance)
        assert [(p.start + 5, p.stop + 5, *p.markers) for p in here] == [
            (p.start, p.stop, *p.markers) for p in there
        ]


def near_and_far(markers):
    """Markers 100 mm apart in a row."""
    place = 100.0 * np.arange(markers)
    return np.abs(place[:, None] - place)


def test_a_far_marker_cuts_no_piece_and_a_near_one_does():
    valid = np.ones((100, 12), dtype=bool)
    valid[20:80, 0] = False
    valid[40:60, 11] = False
    group = gap_groups(~valid)[0]
    mine = [p for p in pieces_of(group, valid, near_and_far(12)) if p.markers[0] == 0]
    assert [(p.start, p.stop) for p in mine] == [(20, 80)]
    assert 11 not in mine[0].visible
    valid[40:60, 11] = True
    valid[40:60, 1] = False
    group = gap_groups(~valid)[0]
    mine = [p for p in pieces_of(group, valid, near_and_far(12)) if p.markers[0] == 0]
    assert [(p.start, p.stop) for p in mine] == [(20, 40), (40, 60), (60, 80)]


def test_flickering_markers_do_not_make_many_pieces():
    rng = np.random.default_rng(0)
    valid = rng.random((400, 30)) > 0.05
    valid[50:350, 0] = False
    groups = gap_groups(~valid)
    mine = [
        p
        for group in groups
        for p in pieces_of(group, valid, near_and_far(30))
        if p.stop - p.start > 0 and 0 in p.markers and 50 <= p.start < 350
    ]
    assert sum(p.stop - p.start for p in mine) == 300
    assert len(mine) <= 3 * MAX_PIECES

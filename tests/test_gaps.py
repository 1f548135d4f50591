import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from priorfill.gaps import (
    Gap,
    constant_spans,
    find_gaps,
    gap_groups,
)

masks = arrays(np.bool_, st.tuples(st.integers(1, 20), st.integers(1, 4)))


def test_gaps_of_a_small_clip():
    missing = np.zeros((8, 3), dtype=bool)
    missing[0:2, 1] = True
    missing[1:4, 2] = True
    missing[6:8, 0] = True
    assert find_gaps(missing) == [Gap(0, 2, 1), Gap(1, 4, 2), Gap(6, 8, 0)]
    groups = gap_groups(missing)
    assert [(g.start, g.stop, g.markers) for g in groups] == [(0, 4, (1, 2)), (6, 8, (0,))]


@given(masks)
def test_gaps_cover_exactly_what_is_missing(missing):
    covered = np.zeros_like(missing)
    for gap in find_gaps(missing):
        assert gap.frames > 0
        assert not covered[gap.start : gap.stop, gap.marker].any()
        covered[gap.start : gap.stop, gap.marker] = True
        # a gap is maximal
        assert gap.start == 0 or not missing[gap.start - 1, gap.marker]
        assert gap.stop == len(missing) or not missing[gap.stop, gap.marker]
    np.testing.assert_array_equal(covered, missing)


@given(masks)
def test_groups_hold_every_gap_once_and_are_apart(missing):
    groups = gap_groups(missing)
    assert sorted(gap for group in groups for gap in group.gaps) == find_gaps(missing)
    for group in groups:
        assert missing[group.start : group.stop].any(axis=1).all()
        assert all(group.start <= g.start and g.stop <= group.stop for g in group.gaps)
    for one, other in itertools.pairwise(groups):
        assert one.stop < other.start


def test_constant_spans():
    seen = np.array([[1, 1], [1, 1], [0, 1], [1, 1]], dtype=bool)
    assert constant_spans(seen) == [(0, 2), (2, 3), (3, 4)]
    assert constant_spans(seen[:1]) == [(0, 1)]


def test_markers_of_a_group_ascend():
    missing = np.zeros((5, 12), dtype=bool)
    missing[2, [11, 8, 1]] = missing[3, 8] = True
    (group,) = gap_groups(missing)
    assert group.markers == (1, 8, 11)
    assert [gap.frames for gap in group.gaps] == [1, 1, 2]

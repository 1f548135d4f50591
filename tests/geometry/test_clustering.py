"""Linkage, against SciPy's hierarchical clustering."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from priorfill.geometry.clustering import complete_linkage, single_linkage


@settings(max_examples=30)
@given(st.integers(0, 2**31), st.integers(2, 20), st.floats(0.05, 2.0))
@pytest.mark.parametrize(
    ("group", "linking"), [(single_linkage, "single"), (complete_linkage, "complete")]
)
def test_groups_are_those_of_hierarchical_clustering(group, linking, seed, count, limit) -> None:
    distance = np.random.default_rng(seed).random((count, count))
    distance = distance + distance.T
    np.fill_diagonal(distance, 0.0)
    tree = linkage(squareform(distance, checks=False), linking)
    cluster = fcluster(tree, limit, "distance")
    expected = [np.flatnonzero(cluster == c).tolist() for c in dict.fromkeys(cluster)]
    assert [one.tolist() for one in group(distance, limit)] == expected


def test_infinite_distances_are_never_within_a_group() -> None:
    distance = np.array([[0.0, np.inf], [np.inf, 0.0]])
    for group in (single_linkage, complete_linkage):
        assert [one.tolist() for one in group(distance, 1.0)] == [[0], [1]]
        assert [one.tolist() for one in group(np.zeros((1, 1)), 1.0)] == [[0]]


@pytest.mark.parametrize(
    ("group", "apart"), [(single_linkage, []), (complete_linkage, [[0, 1], [2]])]
)
def test_the_greatest_distance_is_within_a_group(group, apart) -> None:
    places = np.array([0.0, 2.0, 4.0])
    distance = np.abs(places[:, None] - places)
    joined = [[0, 1, 2]]
    assert [one.tolist() for one in group(distance, 2.0)] == (apart or joined)
    assert [one.tolist() for one in group(distance, 4.0)] == joined
    assert [one.tolist() for one in group(distance, 1.999)] == [[0], [1], [2]]


def test_the_nearest_groups_are_joined_first() -> None:
    places = np.array([0.0, 3.0, 5.0, 9.0])  # 3 and 5 first; then 0 and 9 are too far from them
    distance = np.abs(places[:, None] - places)
    assert [one.tolist() for one in complete_linkage(distance, 4.5)] == [[0], [1, 2], [3]]
    assert [one.tolist() for one in complete_linkage(distance, 5.0)] == [[0, 1, 2], [3]]
    assert [one.tolist() for one in single_linkage(distance, 3.0)] == [[0, 1, 2], [3]]

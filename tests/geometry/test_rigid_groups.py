"""Groups of markers whose mutual distances hardly vary."""

from __future__ import annotations

import numpy as np
import pytest

from priorfill.geometry.rigid_groups import (
    MAX_SPREAD,
    MIN_SPREAD,
    SPREAD_SHARE,
    rigid_groups,
)


def spreads(markers, *pairs, otherwise):
    """A symmetric matrix of spreads (mm): of the pairs (one, other, spread), and of all others."""
    matrix = np.full((markers, markers), float(otherwise))
    np.fill_diagonal(matrix, 0.0)
    for one, other, spread in pairs:
        matrix[one, other] = matrix[other, one] = spread
    return matrix


@pytest.mark.parametrize(
    ("usual", "threshold"),
    [
        (4.0, MIN_SPREAD),
        (40.0, SPREAD_SHARE * 40.0),
        (60.0, SPREAD_SHARE * 60.0),
        (500.0, MAX_SPREAD),
    ],
)
def test_the_threshold_is_a_share_of_the_median_within_bounds(usual, threshold):
    for factor, groups in ((0.999, [[0, 1], [2], [3]]), (1.001, [[0], [1], [2], [3]])):
        spread = spreads(4, (0, 1, factor * threshold), otherwise=usual)
        assert rigid_groups(spread) == groups


def test_the_median_is_that_of_the_known_pairs():
    # including estimates through a third marker 5, 20, 20, 155 and 155 mm; one is unknown
    spread = spreads(4, (0, 1, 5.0), (0, 2, 20.0), (1, 3, 155.0), otherwise=np.inf)
    assert rigid_groups(spread) == [[0], [1], [2], [3]]
    spread[0, 1] = spread[1, 0] = 0.999 * SPREAD_SHARE * 20.0
    assert rigid_groups(spread)[0] == [0, 1]


def test_an_unknown_pair_is_estimated_through_its_best_third_marker():
    # through marker 2 no more than 2.0 mm, through marker 3 no more than 30 mm
    known = [(0, 2, 2.0), (1, 2, 1.0), (0, 3, 30.0), (1, 3, 30.0), (2, 3, 30.0)]
    spread = spreads(4, *known, otherwise=np.inf)
    assert rigid_groups(spread) == [[0, 1, 2], [3]]
    # one of the two being rigid with the third marker is not enough
    known[0] = (0, 2, 30.0)
    spread = spreads(4, *known, otherwise=np.inf)
    assert rigid_groups(spread) == [[0], [1, 2], [3]]


def test_a_chain_of_joints_is_not_one_group():
    spread = spreads(4, (0, 1, 1.0), (1, 2, 1.1), (2, 3, 1.0), otherwise=60.0)
    assert rigid_groups(spread) == [[0, 1], [2, 3]]


def test_few_markers():
    assert rigid_groups(np.zeros((1, 1))) == [[0]]
    assert rigid_groups(spreads(2, otherwise=np.inf)) == [[0], [1]]
    assert rigid_groups(spreads(2, otherwise=MIN_SPREAD)) == [[0, 1]]

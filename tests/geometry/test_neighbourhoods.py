"""Very many markers are divided into neighbourhoods."""

import numpy as np
import pytest

from priorfill.geometry.neighbourhoods import MAX_FRAMES, mean_places, neighbourhoods


@pytest.mark.parametrize(("markers", "most"), [(1, 4), (4, 4), (5, 4), (1000, 64)])
def test_every_marker_is_in_one_group(markers, most):
    positions = np.random.default_rng(0).normal(0.0, 900.0, (3, markers, 3))
    groups = neighbourhoods(positions, most)
    np.testing.assert_array_equal(np.sort(np.concatenate(groups)), np.arange(markers))
    assert all((np.diff(group) > 0).all() for group in groups)
    assert all(len(group) <= most for group in groups)
    assert min(len(group) for group in groups) >= min(most // 2, markers)
    assert [group[0] for group in groups] == sorted(group[0] for group in groups)


def test_bodies_that_stand_apart_are_not_mixed():
    rng = np.random.default_rng(1)
    body = np.tile(np.arange(4), 50)
    positions = rng.normal(0.0, 300.0, (20, 200, 3)) + 5000.0 * body[:, None] * [1.0, 0.3, 0.0]
    positions[rng.random((20, 200)) < 0.5] = np.nan
    for group in neighbourhoods(positions, 50):
        assert len(set(body[group])) == 1


def test_places_are_means_of_what_is_seen():
    positions = np.full((3 * MAX_FRAMES, 3, 3), np.nan)
    positions[::2, 0] = 1.0
    positions[1::2, 0] = 3.0
    positions[1, 1] = 7.0  # in a frame that is not among those used
    places = mean_places(positions)
    np.testing.assert_allclose(places[0], 2.0, atol=0.1)
    np.testing.assert_array_equal(places[1], 7.0)
    assert np.isnan(places[2]).all()
    assert len(neighbourhoods(positions, 2)) == 2
    assert len(neighbourhoods(np.full((2, 5, 3), np.nan), 2)) == 3

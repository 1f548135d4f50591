"""The weights of neighbours in `baumann2011` and `neighbours`, and the checks of options."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from priorfill.errors import OptionError
from priorfill.methods import get_options
from priorfill.methods.baumann2011.neighbour_votes import vote_weights
from priorfill.methods.baumann2011.weighted_votes import NeighboursOptions


@given(st.integers(0, 10**6))
def test_weights_follow_their_formula(seed: int) -> None:
    distance = np.random.default_rng(seed).uniform(1.0, 200.0, (5, 9))
    found = vote_weights(distance, by_distance=True)
    for row, weights in zip(distance, found, strict=True):
        width = np.sort(row)[4]
        expected = np.array([np.exp(-(d**2) / (2 * width**2)) for d in row])
        np.testing.assert_allclose(weights, expected * 9 / sum(expected))
    assert (vote_weights(distance, by_distance=False) == 1.0).all()


def test_equal_poses_have_equal_weights() -> None:
    np.testing.assert_allclose(vote_weights(np.zeros((2, 4)), by_distance=True), 1.0)


def test_neighbours_weights_votes_and_searches_the_clip() -> None:
    assert get_options("neighbours") == NeighboursOptions(64, 4, 16, True, True, 64)
    assert not get_options("baumann2011").weight_by_distance


@pytest.mark.parametrize(
    ("method", "values"),
    [
        ("baumann2011", {"neighbours": 0}),
        ("krueger2010", {"min_viable": 1}),
        ("rigid", {"max_neighbours": 2}),
        ("lds", {"hidden_dimensions": 0}),
        ("r1", {"min_singular_share": 1.5}),
        ("pma", {"high_quantile": 2.0}),
        ("pca-train", {"rank": 0}),
    ],
)
def test_options_out_of_range_are_refused(method: str, values: dict[str, Any]) -> None:
    with pytest.raises(OptionError, match=f"Options.{next(iter(values))} is"):
        replace(get_options(method), **values)

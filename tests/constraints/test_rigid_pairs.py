"""Distances kept among the markers of a blackout."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.constraints.rigid_pairs import (
    RigidPairOptions,
    hold_rigid_pairs,
    rigid_marker_groups,
)
from priorfill.errors import OptionError
from priorfill.geometry.distances import norms, pair_distances

Array = np.ndarray


def two_bodies(seed: int, frames: int = 40) -> Array:
    """Two rigid bodies of four markers that move independently, and a lone marker."""
    rng = np.random.default_rng(seed)
    bodies = []
    for _ in range(2):
        shape = rng.uniform(-100.0, 100.0, (4, 3))
        turns = np.linalg.qr(rng.normal(size=(frames, 3, 3)))[0]
        bodies.append(shape @ turns + rng.normal(scale=300.0, size=(frames, 1, 3)))
    bodies.append(rng.normal(scale=300.0, size=(frames, 1, 3)))
    return np.concatenate(bodies, axis=1)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_deformed_body_gets_its_shape_back(seed: int) -> None:
    truth = two_bodies(seed)
    distance, spread = pair_distances(truth)
    error = np.random.default_rng(seed + 1).normal(scale=10.0, size=truth.shape)
    rms = np.full(truth.shape[:2], 17.0)
    held = hold_rigid_pairs(truth + error, rms, distance, spread)
    first, second = np.nonzero(np.triu(spread < 1.0, 1))
    assert len(first) == 12
    wrong = np.abs(norms(held[:, first] - held[:, second]) - distance[first, second])
    before = truth + error
    was = np.abs(norms(before[:, first] - before[:, second]) - distance[first, second])
    assert wrong.mean() < 0.2 * was.mean()
    # six of twelve degrees of freedom are left to each body, so a share of the error is gone
    assert norms(held - truth)[:, :8].mean() < 0.85 * norms(error)[:, :8].mean()
    np.testing.assert_array_equal(held[:, 8], before[:, 8])


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), most=st.integers(1, 6))
def test_groups_are_those_of_single_linkage(seed: int, most: int) -> None:
    rng = np.random.default_rng(seed)
    spread = rng.uniform(0.0, 30.0, (9, 9))
    spread = np.maximum(spread, spread.T)
    found = rigid_marker_groups(spread, RigidPairOptions(max_markers=most))
    groups = [{marker} for marker in range(9)]
    pairs = sorted((spread[a, b], a, b) for a in range(9) for b in range(a + 1, 9))
    for size, a, b in pairs:
        one, other = (next(g for g in groups if marker in g) for marker in (a, b))
        if size < 10.0 and one is not other and len(one) + len(other) <= most:
            one |= other
            groups.remove(other)
    assert sorted(map(set, (group.tolist() for group in found)), key=min) == sorted(
        (group for group in groups if len(group) > 1), key=min
    )


def test_options_out_of_range_are_refused() -> None:
    with pytest.raises(OptionError, match="max_markers"):
        RigidPairOptions(max_markers=0)

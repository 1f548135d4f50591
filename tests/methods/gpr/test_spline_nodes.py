"""Spline nodes of segments of several markers, and the splines through the predictions there."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.gp.ensemble import Regression
from priorfill.gp.velocities import VelocityPrediction
from priorfill.methods.gpr.gap_segments import GapSegment
from priorfill.methods.gpr.spline_nodes import (
    SplineNodeOptions,
    interpolate_nodes,
    spline_nodes,
)


def segment(start, stop, markers=3):
    return GapSegment(np.arange(markers), start, stop, np.arange(10, 20))


@settings(max_examples=100, deadline=None)
@given(
    st.integers(0, 500),
    st.integers(1, 600),
    st.integers(0, 40),
    st.integers(0, 40),
    st.floats(1.0, 2000.0),
)
def test_nodes_are_dense_enough(start, length, before, after, rate):
    stop = start + length
    frames = np.arange(start - before, stop + after)
    nodes, inside = spline_nodes(frames, segment(start, stop), rate)
    assert nodes[0] == frames[0]
    assert nodes[-1] == frames[-1]
    gaps = np.diff(nodes)
    assert (gaps >= 1).all()
    assert gaps.max(initial=1) <= max(1.0, rate / SplineNodeOptions.rate)
    near_edge = (
        np.minimum(np.abs(frames - start), np.abs(frames - (stop - 1)))
        < SplineNodeOptions.edge_seconds * rate
    )
    assert set(frames[near_edge]) <= set(nodes)
    # the nodes inside the segment are evenly spaced
    spaced = nodes[inside]
    assert spaced[0] == start
    assert (spaced < stop).all()
    assert len(set(np.diff(spaced))) <= 1


@pytest.mark.parametrize(("rate", "step"), [(60.0, 1), (100.0, 2), (240.0, 4)])
def test_nodes_of_a_single_marker_are_denser(rate, step):
    nodes, inside = spline_nodes(np.arange(90, 310), segment(100, 300, markers=1), rate)
    assert np.diff(nodes).max() == step
    assert inside.sum() == 200 // step


def found_at(nodes, path):
    expected_rms = np.stack([1.0 + nodes % 7, 2.0 + nodes % 5], axis=1).astype(float)
    velocity = VelocityPrediction(10.0 * path, 3.0 * expected_rms, np.ones(2))
    return Regression(path, expected_rms, 1.6, velocity)


def test_predictions_at_nodes_are_kept_and_cubics_are_interpolated_exactly():
    nodes, _ = spline_nodes(np.arange(180, 440), segment(200, 420), 120.0)
    frames = np.arange(180, 440)
    cubic = np.random.default_rng(0).normal(size=(4, 2, 3))

    def path(at):
        return np.einsum("kmc,kt->tmc", cubic, np.vander((at - 300) / 60.0, 4).T)

    found = found_at(nodes, path(nodes))
    interpolated = interpolate_nodes(found, nodes)
    assert len(nodes) < 0.6 * len(frames)
    np.testing.assert_allclose(interpolated.positions, path(frames), atol=1e-9)
    np.testing.assert_allclose(interpolated.velocity.velocity, 10.0 * path(frames), atol=1e-8)
    at = nodes - nodes[0]
    for every, some in (
        (interpolated.positions, found.positions),
        (interpolated.expected_rms, found.expected_rms),
        (interpolated.velocity.velocity, found.velocity.velocity),
        (interpolated.velocity.expected_rms, found.velocity.expected_rms),
    ):
        np.testing.assert_array_equal(every[at], some)
    for node, following in pairwise(at):
        low, high = np.sort(interpolated.expected_rms[[node, following]], axis=0)
        inner = interpolated.expected_rms[node : following + 1]
        assert (inner >= low - 1e-12).all()
        assert (inner <= high + 1e-12).all()


def test_nothing_changes_where_all_frames_are_nodes():
    nodes = np.arange(5, 30)
    found = found_at(nodes, np.ones((25, 2, 3)))
    assert interpolate_nodes(found, nodes) is found


@pytest.mark.parametrize("rate", [100.0, 120.0, 240.0])
def test_fast_movement_is_interpolated_accurately(rate):
    frames = np.arange(1000)
    nodes, _ = spline_nodes(frames, segment(0, 1000), rate)
    wave = np.sin(2.0 * np.pi * 8.0 * frames / rate)[:, None, None] * np.ones((1, 2, 3))
    missed = interpolate_nodes(found_at(nodes, wave[nodes]), nodes).positions - wave
    assert np.abs(missed).max() < 0.01

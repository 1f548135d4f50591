"""Knots of limbs' pieces, and the curves through what is predicted of them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.gp.ensemble import Regression
from priorfill.gp.velocities import Motion
from priorfill.methods.gpr.gap_segments import Piece
from priorfill.methods.gpr.spline_nodes import (
    EDGE,
    KNOT_RATE,
    between,
    knots,
)


def piece(start, stop, markers=3):
    return Piece(np.arange(markers), start, stop, np.arange(10, 20))


@settings(max_examples=100, deadline=None)
@given(
    st.integers(0, 500),
    st.integers(1, 600),
    st.integers(0, 40),
    st.integers(0, 40),
    st.floats(1.0, 2000.0),
)
def test_knots_are_dense_enough(start, length, before, after, rate):
    stop = start + length
    frames = np.arange(start - before, stop + after)
    chosen, even = knots(frames, piece(start, stop), rate)
    assert chosen[0] == frames[0]
    assert chosen[-1] == frames[-1]
    gaps = np.diff(chosen)
    assert (gaps >= 1).all()
    assert gaps.max(initial=1) <= max(1.0, rate / KNOT_RATE)
    beside = np.minimum(np.abs(frames - start), np.abs(frames - (stop - 1))) < EDGE * rate
    assert set(frames[beside]) <= set(chosen)
    # those that stand for the gap are evenly spread over it, and not beside it
    spread = chosen[even]
    assert spread[0] == start
    assert (spread < stop).all()
    assert len(set(np.diff(spread))) <= 1


def test_of_a_single_marker_every_frame_is_one():
    chosen, even = knots(np.arange(90, 310), piece(100, 300, markers=1), 240.0)
    assert chosen.tolist() == list(range(90, 310))
    assert even.sum() == 200


def found_at(chosen, path):
    expected_rms = np.stack([1.0 + chosen % 7, 2.0 + chosen % 5], axis=1).astype(float)
    motion = Motion(10.0 * path, 3.0 * expected_rms, np.ones(2))
    return Regression(path, expected_rms, 1.6, motion)


def test_knots_keep_what_was_found_and_cubics_are_led_through_exactly():
    chosen, _ = knots(np.arange(180, 440), piece(200, 420), 120.0)
    frames = np.arange(180, 440)
    cubic = np.random.default_rng(0).normal(size=(4, 2, 3))

    def path(at):
        return np.einsum("kmc,kt->tmc", cubic, np.vander((at - 300) / 60.0, 4).T)

    found = found_at(chosen, path(chosen))
    led = between(found, chosen)
    assert len(chosen) < 0.6 * len(frames)
    np.testing.assert_allclose(led.positions, path(frames), atol=1e-9)
    np.testing.assert_allclose(led.motion.velocity, 10.0 * path(frames), atol=1e-8)
    at = chosen - chosen[0]
    for whole, some in (
        (led.positions, found.positions),
        (led.expected_rms, found.expected_rms),
        (led.motion.velocity, found.motion.velocity),
        (led.motion.expected_rms, found.motion.expected_rms),
    ):
        np.testing.assert_array_equal(whole[at], some)
    for knot, following in pairwise(at):
        low, high = np.sort(led.expected_rms[[knot, following]], axis=0)
        inner = led.expected_rms[knot : following + 1]
        assert (inner >= low - 1e-12).all()
        assert (inner <= high + 1e-12).all()


def test_where_all_are_knots_nothing_changes():
    chosen = np.arange(5, 30)
    found = found_at(chosen, np.ones((25, 2, 3)))
    assert between(found, chosen) is found


@pytest.mark.parametrize("rate", [100.0, 120.0, 240.0])
def test_movement_is_hardly_missed(rate):
    frames = np.arange(1000)
    chosen, _ = knots(frames, piece(0, 1000), rate)
    wave = np.sin(2.0 * np.pi * 8.0 * frames / rate)[:, None, None] * np.ones((1, 2, 3))
    missed = between(found_at(chosen, wave[chosen]), chosen).positions - wave
    assert np.abs(missed).max() < 0.01

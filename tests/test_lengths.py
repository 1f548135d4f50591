"""Segments keep their lengths."""

from __future__ import annotations

from unittest import mock

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from naive import turned
from scipy.optimize import least_squares

from priorfill.distances import pair_distances
from priorfill.lengths import CAUTION, LEAST_SPREAD, SOFTNESS, Edges, hold_lengths, stiff_edges
from priorfill.springs import STIFF


def arm(frames=40, seed=0):
    """A body of three markers, and an upper arm and a forearm of two each (frames, 7, 3)."""
    rng = np.random.default_rng(seed)
    body = np.array([[0.0, 0, 0], [300, 0, 0], [0, 200, 0]])
    clip = []
    for _ in range(frames):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        upper = np.array([300.0, 0, 0]) + np.array([[100.0, 0, 0], [250, 0, 0]]) @ turn
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        lower = upper[1] + np.array([[100.0, 0, 0], [200, 0, 0]]) @ turn
        clip.append(np.concatenate([body, upper, lower]))
    return np.array(clip)


MISSING, VISIBLE = np.arange(3, 7), np.arange(3)


def chosen(clip):
    return stiff_edges(*pair_distances(clip), MISSING, VISIBLE)


def test_each_marker_hangs_on_the_stiffest():
    edges = chosen(arm())
    pairs = {
        (MISSING[a], np.r_[MISSING, VISIBLE][b])
        for a, b in zip(edges.one, edges.other, strict=True)
    }
    assert len(pairs) == 4  # a tree
    assert (3, 1) in pairs  # on the shoulder
    assert all({3, 4} >= set(p) or {4, 5, 6} >= set(p) for p in pairs - {(3, 1)})
    assert (edges.spread < STIFF).all()


def test_nothing_holds_what_varies():
    clip = arm()
    distance, spread = pair_distances(clip)
    assert len(stiff_edges(distance, spread + STIFF, MISSING, VISIBLE).one) == 0
    edges = stiff_edges(distance, spread + STIFF, MISSING, VISIBLE)
    held = hold_lengths(clip[:, 3:], np.ones((40, 4)), clip[:, :3], edges)
    np.testing.assert_array_equal(held, clip[:, 3:])


def test_lengths_come_nearer():
    clip = arm()
    edges = chosen(clip)
    short = clip[:, 3:].mean(axis=0) + 0.6 * (clip[:, 3:] - clip[:, 3:].mean(axis=0))
    held = hold_lengths(short, np.full((40, 4), 60.0), clip[:, :3], edges)

    def off(missing):
        points = np.concatenate([missing, clip[:, :3]], axis=1)
        length = np.linalg.norm(points[:, edges.one] - points[:, edges.other], axis=2)
        return np.abs(length - edges.length).mean()

    assert off(held) < 0.5 * off(short)
    assert np.linalg.norm(held - clip[:, 3:], axis=2).mean() < (
        np.linalg.norm(short - clip[:, 3:], axis=2).mean()
    )


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31))
def test_it_is_the_minimum_of_its_least_squares(seed):
    clip = arm(frames=12, seed=seed % 1000)
    rng = np.random.default_rng(seed)
    edges = chosen(clip)
    predicted = clip[:1, 3:] + rng.normal(0, 10.0, (1, 4, 3))
    deviation = rng.uniform(5.0, 30.0, (1, 4))
    held = hold_lengths(predicted, deviation, clip[:1, :3], edges)[0]
    variance = deviation[0] ** 2 / 3.0

    def terms(x):
        points = np.concatenate([x.reshape(4, 3), clip[0, :3]])
        off = [
            (np.linalg.norm(points[a] - points[b]) - length)
            / np.sqrt((CAUTION * s) ** 2 + SOFTNESS**2 * variance[a])
            for a, b, length, s in zip(
                edges.one, edges.other, edges.length, edges.spread, strict=True
            )
        ]
        away = (points[:4] - predicted[0]) / np.sqrt(variance)[:, None]
        return np.concatenate([away.ravel(), off])

    # lengths have more than one minimum: none is near that is lower
    best = least_squares(terms, held.ravel(), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    reached = (terms(held.ravel()) ** 2).sum()
    assert reached < 1.001 * 2.0 * best.cost + 1e-6
    assert reached <= (terms(predicted[0].ravel()) ** 2).sum()


def test_it_turns_and_moves_with_the_body():
    clip = arm()
    edges = chosen(clip)
    predicted = clip[:, 3:] + np.random.default_rng(1).normal(0, 20.0, (40, 4, 3))
    deviation = np.full((40, 4), 30.0)
    shift = np.array([500.0, -2000.0, 30.0])
    held = hold_lengths(predicted, deviation, clip[:, :3], edges)
    moved = [turned(x, 1.1, shift) for x in (predicted, clip[:, :3], held)]
    np.testing.assert_allclose(
        hold_lengths(moved[0], deviation, moved[1], edges), moved[2], atol=1e-8
    )


def test_frames_and_other_visible_markers_make_no_difference():
    clip = arm()
    edges = chosen(clip)
    predicted = clip[:, 3:] + np.random.default_rng(2).normal(0, 20.0, (40, 4, 3))
    deviation = np.full((40, 4), 30.0)
    held = hold_lengths(predicted, deviation, clip[:, :3], edges)
    anchors, fewer = edges.anchored(4)
    assert anchors.tolist() == [1]  # the shoulder
    with mock.patch("priorfill.lengths.AT_ONCE", 7):
        alone = hold_lengths(predicted, deviation, clip[:, anchors], fewer)
    np.testing.assert_allclose(alone, held, atol=1e-9)


def test_markers_that_hang_on_each_other_alone_need_no_visible_one():
    clip = arm()
    edges = chosen(clip)
    inner = edges.other < 4
    free = Edges(*(x[inner] for x in (edges.one, edges.other, edges.length, edges.spread)))
    predicted = clip[:, 3:] + np.random.default_rng(3).normal(0, 20.0, (40, 4, 3))
    deviation = np.full((40, 4), 30.0)
    anchors, fewer = free.anchored(4)
    assert not len(anchors)
    held = hold_lengths(predicted, deviation, clip[:, :3], free)
    alone = hold_lengths(predicted, deviation, clip[:, anchors], fewer)
    np.testing.assert_array_equal(alone, held)
    assert (np.abs(held - predicted) > 1.0).any()


def test_markers_in_one_place_do_no_harm():
    clip = np.zeros((10, 7, 3))
    edges = stiff_edges(*pair_distances(clip), MISSING, VISIBLE)
    held = hold_lengths(clip[:, 3:], np.ones((10, 4)), clip[:, :3], edges)
    assert np.isfinite(held).all()
    assert np.abs(held).max() < LEAST_SPREAD

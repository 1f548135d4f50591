"""Weighted PCA, compared with the published equations step by step; limits of the method."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from gappy import ARM, FOOT, error, fill_unchecked, person, straight, with_gaps
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.clip import Clip
from priorfill.errors import MethodError
from priorfill.formats import read
from priorfill.geometry.axes import from_upright
from priorfill.methods.gloersen2016.weighted_pca import ColumnMoments, mean_distances, regression

METHOD = pytest.mark.parametrize("method", ["r1", "r2"])
SIGMA, LOST, CUTOFF, EXPLAINED = 200.0, 0.02, 0.5, 0.99


def apart(positions: np.ndarray, one: int, other: int) -> float:
    """Mean distance of two markers over the frames that show both."""
    found = [np.linalg.norm(pose[one] - pose[other]) for pose in positions]
    return float(np.mean([d for d in found if np.isfinite(d)]))


def principal(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values and components."""
    _, singular, components = np.linalg.svd(rows / np.sqrt(len(rows) - 1), full_matrices=False)
    return singular, components.T


def enough(singular: np.ndarray) -> int:
    """How many components reach the share."""
    count = 1
    while singular[:count].sum() < EXPLAINED * singular.sum():
        count += 1
    return count


def reconstruct(rows: np.ndarray, lost: list[int], distances: list[float], signs) -> np.ndarray:
    """Fill rows (NaN where missing) by the published steps, with full matrices.

    `signs` is called with the number of components, and returns choices of signs of the columns of
    V0. The mean of the results over these choices is returned.
    """
    weights = [np.exp(-(d**2) / (2 * SIGMA**2)) for d in distances]
    for marker in lost:
        weights[marker] = LOST
    w = np.repeat(weights, 3)
    columns = [3 * marker + axis for marker in lost for axis in range(3)]
    complete = rows[~np.isnan(rows).any(axis=1)]
    mean, deviation = complete.mean(axis=0), complete.std(axis=0)
    deviation[deviation < 1e-9] = 1.0
    full = (complete - mean) / deviation * w
    zeroed = full.copy()
    zeroed[:, columns] = 0.0
    scaled_rows = (rows - mean) / deviation * w
    scaled_rows[:, columns] = 0.0
    singular, V = principal(full)
    singular0, V0 = principal(zeroed)
    count = max(enough(singular), enough(singular0))
    V, V0 = V[:, :count], V0[:, :count]
    found = []
    for sign in signs(count):
        flipped = V0 * np.array(sign)
        T = V.T @ flipped
        found.append(scaled_rows @ flipped @ T @ V.T)
    return mean + np.mean(found, axis=0) * deviation / w


def all_signs(count: int):
    """Each choice of signs."""
    return product([-1.0, 1.0], repeat=count)


def simultaneous(clip: Clip, signs) -> np.ndarray:
    """R1."""
    gappy = [m for m in range(len(clip.labels)) if clip.missing[:, m].any()]
    shown = [m for m in range(len(clip.labels)) if m not in gappy]
    origin = clip.positions[:, shown].mean(axis=1, keepdims=True)
    rows = clip.positions - origin
    distances = [
        min(apart(clip.positions, lost, m) for lost in gappy) for m in range(len(clip.labels))
    ]
    predicted = reconstruct(rows.reshape(len(rows), -1), gappy, distances, signs)
    return np.where(clip.missing[..., None], predicted.reshape(rows.shape) + origin, clip.positions)


def consecutive(clip: Clip, signs) -> np.ndarray:
    """R2."""
    markers = range(len(clip.labels))
    gappy = [m for m in markers if clip.missing[:, m].any()]
    shown = [m for m in markers if m not in gappy]
    origin = clip.positions[:, shown].mean(axis=1, keepdims=True)
    filled = clip.positions.copy()
    for lost in gappy:
        gap = clip.missing[:, lost]
        rows = clip.positions - origin
        distances = [apart(clip.positions, lost, m) for m in markers]
        for other in gappy:
            far = distances[other] > CUTOFF * np.mean(distances)
            if other != lost and (far or clip.missing[gap, other].any()):
                rows[:, other] = 0.0
        training = ~np.isnan(rows).any(axis=(1, 2))
        both = np.concatenate([rows[training], rows[gap]])
        predicted = reconstruct(both.reshape(len(both), -1), [lost], distances, signs)
        predicted = predicted.reshape(both.shape)[training.sum() :, lost]
        filled[gap, lost] = predicted + origin[gap, 0]
    return filled


PUBLISHED = {"r1": simultaneous, "r2": consecutive}


def body(seed: int, markers: int = 7, frames: int = 60) -> Clip:
    """Markers about a walking point, moving by three components and some noise."""
    rng = np.random.default_rng(seed)
    home = rng.normal(size=(markers, 3)) * 250
    modes = rng.normal(size=(3, markers, 3)) * np.array([60.0, 30.0, 15.0])[:, None, None]
    time = np.cumsum(rng.normal(size=(frames, 3)), axis=0) * 0.3
    walk = np.cumsum(rng.normal(size=(frames, 1, 3)), axis=0) * 20
    positions = home + np.tensordot(time, modes, axes=1) + walk + rng.normal(size=walk.shape)
    positions += rng.normal(size=positions.shape) * 0.5
    return Clip(positions, tuple(f"M{i}" for i in range(markers)), 100.0)


def gappy_body(seed: int) -> Clip:
    """Three of its markers with gaps, some of them overlapping."""
    clip = body(seed)
    rng = np.random.default_rng(seed + 1000)
    start = [int(s) for s in rng.integers(0, 45, size=4)]
    return with_gaps(
        clip,
        (start[0], start[0] + 12, ("M1",)),
        (start[1], start[1] + 9, ("M4",)),
        (start[2], start[2] + 15, ("M6",)),
        (start[3], start[3] + 2, ("M6",)),
    )


@METHOD
@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_mean_of_the_published_steps_over_all_signs(method, seed):
    clip = gappy_body(seed)
    expected = PUBLISHED[method](clip, all_signs)
    found = fill_unchecked(clip, method=method)
    assert found.complete
    np.testing.assert_allclose(found.clip.positions, expected, rtol=0, atol=1e-6)


@METHOD
def test_the_published_product_depends_on_arbitrary_signs(method):
    # why only the diagonal is used: an SVD may return either of these
    clip = gappy_body(2)
    one = PUBLISHED[method](clip, lambda count: [[1.0] * count])
    other = PUBLISHED[method](clip, lambda count: [[(-1.0) ** i for i in range(count)]])
    assert np.abs(one - other).max() > 0.5


def test_a_change_of_coordinates_predicts_nothing_with_all_components():
    # why T is not V0' V: its product with all components is the identity, and z0 lacks the columns
    rows = np.random.default_rng(3).normal(size=(40, 2)) @ np.random.default_rng(4).normal(
        size=(2, 9)
    )
    rows += np.random.default_rng(5).normal(size=rows.shape) * 1e-3
    rows -= rows.mean(axis=0)
    lost = np.arange(9) >= 6
    V, V0 = principal(rows)[1], principal(np.where(lost, 0.0, rows))[1][:, :6]
    zeroed = np.where(lost, 0.0, rows)
    np.testing.assert_allclose((zeroed @ V0 @ V0.T @ V @ V.T)[:, lost], 0.0, atol=1e-12)
    weights = np.where(lost, LOST, 1.0)
    slopes = regression(rows.T @ rows / len(rows), weights, lost, 1.0)
    found = rows[:, ~lost] @ slopes
    assert np.abs(found - rows[:, lost]).max() < 0.1 * np.abs(rows[:, lost]).max()


def test_mean_distances():
    rng = np.random.default_rng(0)
    positions = rng.normal(size=(30, 5, 3)) * 100
    valid = rng.random((30, 5)) < 0.6
    valid[:15, 3], valid[15:, 4] = False, False
    positions[~valid] = 0.0
    found = mean_distances(positions, valid, np.array([3, 0]))
    seen = np.where(valid[..., None], positions, np.nan)
    for row, one in zip(found, (3, 0), strict=True):
        for other in range(5):
            if (valid[:, one] & valid[:, other]).any():
                assert row[other] == pytest.approx(apart(seen, one, other), abs=1e-9)
            else:
                assert row[other] == np.inf
    assert found[0, 4] == np.inf
    assert found[0, 3] == 0


def test_moments_over_any_frames():
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(50, 6))
    whole = rng.random(50) < 0.5
    frames = whole | (rng.random(50) < 0.5)
    which = np.array([True, False, True, True, False, True])
    mean, covariance = ColumnMoments(columns, whole).over(frames, which)
    chosen = columns[frames][:, which]
    np.testing.assert_allclose(mean, chosen.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(covariance, np.cov(chosen.T, bias=True), atol=1e-12)


def test_a_copy_is_predicted_from_its_original():
    # two equal columns with weights 1 and w: the component has the variance 1 + w^2; the missing
    # column has the loading w, and the slope on the visible one is 1 / (1 + w^2)
    covariance = np.full((2, 2), 9.0)
    lost = np.array([False, True])
    found = regression(covariance, np.array([1.0, LOST]), lost, EXPLAINED)
    np.testing.assert_allclose(found, [[1 / (1 + LOST**2)]], rtol=1e-12)


def test_markers_at_rest_predict_nothing():
    covariance = np.diag([0.0, 0.0, 4.0])
    lost = np.array([False, False, True])
    found = regression(covariance, np.array([1.0, 1.0, LOST]), lost, EXPLAINED)
    np.testing.assert_array_equal(found, np.zeros((2, 1)))


@METHOD
@given(seed=st.integers(0, 10_000))
@settings(max_examples=10, deadline=None)
def test_walking_order_and_axes_do_not_matter(method, seed):
    clip = gappy_body(seed)
    rng = np.random.default_rng(seed)
    expected = fill_unchecked(clip, method=method).clip.positions
    walk = np.cumsum(rng.normal(size=(clip.frames, 1, 3)), axis=0) * 100
    moved = clip.with_positions(clip.positions + walk)
    np.testing.assert_allclose(
        fill_unchecked(moved, method=method).clip.positions, expected + walk, rtol=0, atol=1e-5
    )
    order = rng.permutation(len(clip.labels))
    mixed = Clip(clip.positions[:, order], tuple(clip.labels[i] for i in order), clip.rate)
    np.testing.assert_allclose(
        fill_unchecked(mixed, method=method).clip.positions, expected[:, order], rtol=0, atol=1e-5
    )
    times = rng.permutation(clip.frames)
    later = clip.with_positions(clip.positions[times])
    np.testing.assert_allclose(
        fill_unchecked(later, method=method).clip.positions, expected[times], rtol=0, atol=1e-5
    )
    lying = Clip(from_upright(clip.positions, "+Y"), clip.labels, clip.rate, up="+Y")
    np.testing.assert_allclose(
        fill_unchecked(lying, method=method).clip.positions,
        from_upright(expected, "+Y"),
        rtol=0,
        atol=1e-5,
    )


def test_one_marker_with_gaps_is_the_same_by_both():
    clip = with_gaps(person(), (60, 130, ("LELB",)), (200, 210, ("LELB",)))
    one, other = (fill_unchecked(clip, method=method).clip.positions for method in ("r1", "r2"))
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-7)


@METHOD
def test_single_markers_are_filled_far_better_than_by_lines(method):
    truth = person().positions
    clip = with_gaps(person(), (60, 130, ("LELB",)), (150, 200, ("RKNE",)), (20, 70, ("C7",)))
    result = fill_unchecked(clip, method=method)
    assert result.complete
    assert {how for gap in result.gaps for how in gap.sources} == {
        "correlations with other markers"
    }
    found = error(result.clip.positions, truth, result.filled)
    assert found < 0.2 * error(straight(clip), truth, result.filled)


def test_marker_by_marker_uses_what_all_at_once_cannot():
    # few frames are complete, since the gaps follow one another
    labels = ("LELB", "RKNE", "RANK", "LFHD", "T10", "RTOE", "LWRA")
    gaps = [(30 * i, 30 * i + 33, (label,)) for i, label in enumerate(labels)]
    clip, truth = with_gaps(person(), *gaps), person().positions
    errors = {}
    for method in ("r1", "r2"):
        result = fill_unchecked(clip, method=method)
        assert result.complete
        errors[method] = error(result.clip.positions, truth, result.filled)
    assert errors["r2"] < 0.7 * errors["r1"]


@METHOD
def test_dropouts_and_blackouts_are_left_and_the_rest_is_filled(method):
    everything = person().labels
    kept = with_gaps(person(), (60, 130, ARM), (150, 190, FOOT))
    clip = with_gaps(kept, (0, 240, ("C7",)), (100, 110, everything))
    result = fill_unchecked(clip, method=method)
    for gap in result.gaps:
        whole = gap.label == "C7"
        blackout = [] if whole else [(100, 110)]
        assert [(part.start, part.stop) for part in gap.unfilled] == (
            [(0, 240)] if whole else blackout if gap.start <= 100 < gap.stop else []
        )
        for part in gap.unfilled:
            assert part.reason.startswith("never visible" if whole else "no marker is visible")
    # as if the marker and the frames did not exist
    frames = np.r_[:100, 110:240]
    others = [i for i, label in enumerate(everything) if label != "C7"]
    less = Clip(kept.positions[frames][:, others], tuple(everything[i] for i in others), 60.0)
    np.testing.assert_allclose(
        result.clip.positions[frames][:, others],
        fill_unchecked(less, method=method).clip.positions,
        rtol=0,
        atol=1e-6,
    )


@METHOD
def test_gaps_that_stay_have_a_reason(method):
    blackout = with_gaps(person(), (80, 95, person().labels))
    dropout = with_gaps(person(), (0, 240, ("C7",)))
    for clip, reason in (
        (blackout, "no marker is visible; use auto"),
        (dropout, "never visible in the"),
    ):
        result = fill_unchecked(clip, method=method)
        assert not result.filled.any()
        assert all(part.reason.startswith(reason) for gap in result.gaps for part in gap.unfilled)
    labels = person().labels
    nobody = with_gaps(person(), *((5 * i, 5 * i + 4, (x,)) for i, x in enumerate(labels)))
    with pytest.raises(MethodError, match="no marker is visible in all frames with gaps"):
        fill_unchecked(nobody, method=method)


@METHOD
def test_frames_in_which_a_body_walks_in_and_out_are_left(method):
    labels = person().labels
    gaps = (60, 130, ("LELB",)), (150, 190, FOOT)
    seen = {0: labels[:2], 200: labels[5:7]}  # who is seen in the frames left
    out = [(a, a + 40, [x for x in labels if x not in seen[a]]) for a in seen]
    result = fill_unchecked(with_gaps(person(), *gaps, *out), method=method)
    left = {(p.start, p.stop, p.reason) for gap in result.gaps for p in gap.unfilled}
    assert left == {(a, a + 40, "too few markers are visible; use auto") for a in seen}
    middle = person().with_positions(with_gaps(person(), *gaps).positions[40:200])
    np.testing.assert_allclose(
        result.clip.positions[40:200],
        fill_unchecked(middle, method=method).clip.positions,
        rtol=0,
        atol=1e-6,
    )


def test_too_few_frames_to_learn_from():
    labels = person().labels
    # each frame lacks one of two markers, far from each other
    clip = with_gaps(person(), (0, 120, ("LFHD",)), (120, 240, ("RTOE",)))
    with pytest.raises(MethodError, match="no two frames show all markers; use r2 or auto"):
        fill_unchecked(clip, method="r1")
    assert fill_unchecked(clip, method="r2").complete
    # a marker seen in one frame only cannot be predicted, the other can
    clip = with_gaps(person(), (0, 239, ("LFHD",)), (50, 60, ("RTOE",)))
    result = fill_unchecked(clip, method="r2")
    left = {gap.label: [part.reason for part in gap.unfilled] for gap in result.gaps}
    assert left["RTOE"] == []
    assert left["LFHD"][0].startswith("fewer than two frames show it with the markers")
    assert labels.index("LFHD") == 0


def test_neighbours_within_reach_and_seen_in_the_gaps_are_used():
    # LWRB has gaps of its own, but is near LWRA: it is used unless both are missing at once
    def predicted(start: int, extra: float) -> np.ndarray:
        positions = person().positions.copy()
        positions[130:150, person().labels.index("LWRB")] += extra
        clip = with_gaps(
            person().with_positions(positions),
            (130, 150, ("LWRA",)),
            (start, start + 10, ("LWRB",)),
        )
        return fill_unchecked(clip, method="r2").clip.positions[130:150, clip.labels.index("LWRA")]

    assert np.abs(predicted(60, 30.0) - predicted(60, 0.0)).max() > 1.0
    # a marker missing in one of the frames is not used in any
    positions = predicted(140, 0.0)
    np.testing.assert_allclose(predicted(140, 30.0)[:10], positions[:10], rtol=0, atol=1e-6)


@METHOD
@pytest.mark.realdata
def test_walking_as_published(method, data):
    clip = read(data / "walkl" / "WalkL.c3d")
    masks = np.load(data / "walkl" / "missing_masks.npz")["missing"]
    missing = np.unpackbits(masks, axis=1)[0, : clip.frames].astype(bool)
    gappy = clip.with_positions(np.where(missing[..., None], np.nan, clip.positions))
    result = fill_unchecked(gappy, method=method)
    assert result.complete
    # the authors' program has 4.3 and 1.7 mm with this mask
    found = error(result.clip.positions, clip.positions, missing)
    assert found < {"r1": 4.4, "r2": 1.75}[method]


@pytest.mark.parametrize("method", ["r1", "r2"])
def test_a_marker_that_no_usable_frame_shows_is_left(method):
    clip = with_gaps(person(), (0, 235, ("C7",)))
    gappy = clip.positions.copy()
    for frame in range(235, 240):  # too few markers to be used
        gappy[frame, np.arange(len(clip.labels)) != clip.labels.index("C7")] = np.nan
    for frame in range(0, 200, 2):
        gappy[frame, 5 + frame // 2 % 3] = np.nan
    result = fill_unchecked(clip.with_positions(gappy), method=method)
    assert result.filled.any()
    never = [gap for gap in result.gaps if gap.label == "C7"]
    assert [gap.filled for gap in never] == [0]
    assert "fewer than two frames show it" in never[0].unfilled[0].reason

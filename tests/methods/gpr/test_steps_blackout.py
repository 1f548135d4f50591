"""Blackouts: stacking of curves, correction by the edges, and weights of similar windows."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from gappy import person, with_gaps
from scipy.optimize import minimize_scalar

from priorfill.geometry.root_frames import root_group
from priorfill.markers.describe import describe
from priorfill.methods.gpr.blackout.body_size import compare_sizes, constant_distances
from priorfill.methods.gpr.blackout.context_noise import match_noise
from priorfill.methods.gpr.blackout.correction import _left_out_together, correct_from_edges
from priorfill.methods.gpr.blackout.curves import interpolate_correction
from priorfill.methods.gpr.blackout.database_windows import DatabaseWindows
from priorfill.methods.gpr.blackout.edge_features import edge_features
from priorfill.methods.gpr.blackout.fill_blackouts import BlackoutPredictor
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.blackout.predict_blackout import (
    _error_without_windows,
    _from_windows,
    predict_blackout,
)
from priorfill.methods.gpr.blackout.stacking import combine_curves, stacking_weights
from priorfill.methods.gpr.blackout.window_layout import WindowLayout
from priorfill.methods.gpr.blackout.windows import (
    FIRST_TAKE,
    OWN,
    BlackoutWindows,
    MirrorImage,
    WindowSources,
    collect_windows,
)
from priorfill.methods.gpr.gap_segments import GapSegment
from priorfill.methods.gpr.pose_search import PoseSearch, SearchOptions
from priorfill.methods.gpr.training.subject_correlation import SubjectCorrelationOptions
from priorfill.methods.task import THIS_CLIP, Task
from priorfill.search.bank import spaced_rows
from priorfill.signal.gp_interpolation import InterpolationOptions

OPTIONS = BlackoutOptions()
INSIDE = 3
MARKERS = 4


def layout() -> WindowLayout:
    before, after = np.arange(-6, 0), np.arange(12, 18)
    return WindowLayout(frames=12, before=before, after=after, inside=np.array([2, 6, 9]), step=3)


def about_vertical(angles: np.ndarray) -> np.ndarray:
    turns = np.zeros((len(angles), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0], turns[:, 0, 1] = np.sin(angles), -np.sin(angles)
    turns[:, 2, 2] = 1.0
    return turns


def windows_of(
    edges: np.ndarray,
    inside: np.ndarray,
    rotation: np.ndarray,
    source: np.ndarray | None = None,
    subject: np.ndarray | None = None,
) -> BlackoutWindows:
    """Windows that have no frame in common, of the clip by default."""
    count = len(edges)
    return BlackoutWindows(
        context=np.zeros((count, 12, MARKERS, 3)),
        inside=inside,
        edges=edges,
        rotation=rotation,
        start=100 * np.arange(count),
        source=np.full(count, OWN) if source is None else source,
        subject=np.full(count, THIS_CLIP) if subject is None else subject,
        correlation=np.ones(count),
    )


# --- stacking ---


def test_stacking_matches_ridge_regression() -> None:
    """Weights by error to the power of -8 for each marker, then ridge regression by frame.

    The ridge regression is solved as least squares with an additional row for each weight.
    """
    rng = np.random.default_rng(0)
    curves = rng.normal(0.0, 10.0, (3, 1 + 7, INSIDE, 2, 3))
    curves[0] *= 0.5
    truth, weight = rng.normal(0.0, 5.0, (7, INSIDE, 2, 3)), rng.uniform(0.1, 1.0, 7)
    found = combine_curves(stacking_weights(curves[:, 1:], truth, weight, OPTIONS), curves)
    expected = np.zeros_like(found)
    for marker in range(2):
        wrong = ((curves[:, 1:, :, marker] - truth[:, :, marker]) ** 2).sum(axis=3).mean(axis=2)
        error = np.sqrt(wrong @ weight**2 / (weight**2).sum())
        share = error**-8.0 / (error**-8.0).sum()
        expected[:, :, marker] = np.tensordot(share, curves[:, :, :, marker], 1)
    mixed = expected.copy()
    for axes in ([0, 1], [2]):
        for frame in range(INSIDE):
            away = (curves - mixed)[:, :, frame][..., axes]
            matrix = (away[:, 1:] * weight[:, None, None]).reshape(3, -1).T
            side = ((truth - mixed[1:])[:, frame][..., axes] * weight[:, None, None]).ravel()
            ridge = np.diag(np.sqrt(OPTIONS.stacking_ridge * (matrix**2).sum(axis=0)))
            step = np.linalg.lstsq(
                np.concatenate([matrix, ridge]), np.concatenate([side, np.zeros(3)]), rcond=None
            )[0]
            expected[:, frame][..., axes] += np.tensordot(step, away, 1)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8)
    assert np.abs(found - mixed).max() > 0.5  # the regression changes the result


def test_windows_of_little_weight_do_not_choose_the_curve() -> None:
    rng = np.random.default_rng(1)
    truth = rng.normal(0.0, 100.0, (20, INSIDE, MARKERS, 3))
    noise = rng.normal(0.0, 10.0, (2, 20, INSIDE, MARKERS, 3))
    first = np.arange(20) < 10
    # each curve is right in half of the windows
    right = np.stack([first, ~first])[..., None, None, None]
    blackout = rng.normal(0.0, 10.0, (2, 1, INSIDE, MARKERS, 3))
    curves = np.concatenate([blackout, truth + np.where(right, 0.0, noise)], axis=1)
    for favoured, weight in ((0, np.where(first, 1.0, 0.05)), (1, np.where(first, 0.05, 1.0))):
        weights = stacking_weights(curves[:, 1:], truth, weight, OPTIONS)
        stacked = combine_curves(weights, curves)[0]
        away = np.linalg.norm(stacked - blackout[:, 0], axis=-1).mean((1, 2))
        assert away[favoured] < 0.2 * away[1 - favoured]


# --- correction ---


def problem(
    seed: int, explained: float
) -> tuple[BlackoutWindows, np.ndarray, np.ndarray, np.ndarray]:
    """Windows, and errors of their curves, which the edges explain in part."""
    rng = np.random.default_rng(seed)
    count = 1 + 14
    edges = rng.normal(0.0, 50.0, (count, 6))
    values = INSIDE * MARKERS * 3
    wrong = explained * edges[1:] @ rng.normal(0.0, 0.3, (6, values))
    wrong += rng.normal(0.0, 10.0, (count - 1, values))
    none = np.zeros((count, INSIDE, MARKERS, 3))
    windows = windows_of(edges, none, about_vertical(np.zeros(count)))
    return windows, wrong, rng.uniform(0.5, 2.0, count), rng.uniform(0.2, 1.0, count - 1)


def refitted(
    windows: BlackoutWindows, wrong: np.ndarray, scale: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The correction and its residuals, solved again without each window."""
    count = len(wrong)
    features = windows.edges - windows.edges[1:].mean(axis=0)
    features = features / np.sqrt((features[1:] ** 2).sum(axis=1).mean())
    away = ((features[:, None] - features) ** 2).sum(axis=2)
    part = weight / np.sqrt((weight**2).sum())
    predictions, errors = [], []
    for length in (0.4, 0.7):
        kernel = 0.1 * features @ features.T + np.exp(-away / (2 * length**2)) + 1.0
        for noise in (0.1, 0.5):
            for power in OPTIONS.correction_exponents:
                by = scale**power

                def predict(
                    window: Any, rows: np.ndarray, k: Any = kernel, noise: Any = noise, by: Any = by
                ) -> np.ndarray:
                    matrix = k[np.ix_(rows, rows)] + noise * np.eye(len(rows))
                    values = wrong[rows - 1] / by[rows, None]
                    return by[window] * (k[window, rows] @ np.linalg.solve(matrix, values))

                everyone = np.arange(1, 1 + count)
                out = [predict(w, everyone[everyone != w]) for w in everyone]
                predictions.append((predict(0, everyone), np.array(out)))
                left = wrong - predictions[-1][1]
                errors.append(np.sqrt(((part[:, None] * left) ** 2).sum()))
    predictions.append((np.zeros(wrong.shape[1]), np.zeros_like(wrong)))
    errors.append(np.sqrt(((part[:, None] * wrong) ** 2).sum()))
    share = np.array(errors) ** -8.0
    share /= share.sum()
    correction, fitted = (
        sum(s * p[i] for s, p in zip(share, predictions, strict=True)) for i in (0, 1)
    )

    def cost(gain: float) -> float:
        return float(((part[:, None] * (wrong - gain * fitted)) ** 2).sum())

    gain = minimize_scalar(cost, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-9}).x
    return gain * correction, wrong - gain * fitted


@pytest.mark.parametrize("explained", [0.0, 0.15, 1.0])
def test_the_correction_matches_refitting_without_each_window(explained: float) -> None:
    windows, wrong, scale, weight = problem(0, explained)
    every = np.arange(len(wrong))
    correction, left, _ = correct_from_edges(windows, wrong, scale, weight, every, 10, OPTIONS)
    expected, expected_left = refitted(windows, wrong, scale, weight)
    np.testing.assert_allclose(correction, expected, atol=1e-3)
    np.testing.assert_allclose(left, expected_left, atol=1e-3)


def test_the_correction_is_scaled_by_its_cross_validated_gain() -> None:
    """Large where the edges explain the errors, near 0 where they explain nothing."""

    def kept(explained: float) -> float:
        found = []
        for seed in range(5):
            windows, wrong, scale, weight = problem(seed, explained)
            every = np.arange(len(wrong))
            correction, left, _ = correct_from_edges(
                windows, wrong, scale, weight, every, 10, OPTIONS
            )
            square = weight[:, None] ** 2
            # on the windows that determine the gain, never worse than no correction
            assert (square * left**2).sum() <= (square * wrong**2).sum() * (1 + 1e-9)
            found.append(np.sqrt((correction**2).mean()) / np.sqrt((wrong**2).mean()))
        return float(np.median(found))

    assert kept(10.0) > 0.3
    assert kept(0.0) < 0.1


def turned_problem() -> tuple[BlackoutWindows, np.ndarray, np.ndarray]:
    """Curves that err by 5 mm along the body's x axis for each unit of an edge feature."""
    rng = np.random.default_rng(3)
    count = 1 + 30
    feature = rng.uniform(-10.0, 10.0, count)
    feature[0] = 6.0
    rotation = about_vertical(rng.uniform(-3.0, 3.0, count))
    curves = rng.normal(0.0, 100.0, (1, count, INSIDE, MARKERS, 3))
    curves = curves + rng.normal(0.0, 3.0, (4, count, INSIDE, MARKERS, 3))
    wrong = (5.0 * feature[:, None] * [1.0, 0.0, 0.0])[:, None] @ np.swapaxes(rotation, 1, 2)
    truth = curves.mean(axis=0) + wrong[:, None]
    inside = truth.copy()
    inside[0] = np.nan
    return windows_of(feature[:, None], inside, rotation), curves, truth[0]


def test_errors_of_the_curves_are_predicted_from_the_edges_at_any_heading() -> None:
    windows, curves, truth = turned_problem()
    found, expected_rms = _from_windows(
        windows, lambda part: curves[:, part], len(curves), layout(), OPTIONS
    )
    # of 30 mm
    away = np.linalg.norm(found - truth, axis=-1).mean()
    assert away < 8.0
    assert expected_rms.mean() < 12.0


# --- similar windows ---


def two_kinds() -> tuple[BlackoutWindows, np.ndarray]:
    """Quiet windows, in which the first curve is right, and lively ones, where the second is.

    The two curves are 20 mm apart in the blackout and in the quiet windows, 200 mm in the lively
    ones.
    """
    rng = np.random.default_rng(5)
    count = 1 + 12 + 12
    quiet = np.arange(count) <= 12
    middle = rng.normal(0.0, 500.0, (count, INSIDE, MARKERS, 3))
    way = rng.normal(0.0, 1.0, (count, INSIDE, MARKERS, 3))
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    half = np.where(quiet, 10.0, 100.0)[:, None, None, None] * way
    curves = np.stack([middle + half, middle - half])
    inside = np.where(quiet[:, None, None, None], curves[0], curves[1])
    inside += 0.1 * half * rng.normal(0.0, 1.0, half.shape)
    inside[0] = np.nan
    edges = rng.normal(0.0, 50.0, (count, 5))
    return windows_of(edges, inside, about_vertical(np.zeros(count))), curves


def test_windows_whose_curves_disagree_as_the_blackouts_do_count_most() -> None:
    windows, curves = two_kinds()
    found, expected_rms = _from_windows(
        windows, lambda part: curves[:, part], len(curves), layout(), OPTIONS
    )
    away = [np.linalg.norm(found - curve[0], axis=-1).mean() for curve in curves]
    # with equal weights both would be 10 mm
    assert away[0] < 5.0 < 15.0 < away[1]
    # with equal weights the lively windows would make it 29 mm
    assert expected_rms.mean() < 16.0


# --- windows ---


def test_the_mirror_image_is_correlated_with_the_clip_but_not_the_same() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(200)[:, None, None] / 100.0
    positions = rng.normal(0.0, 300.0, (1, MARKERS, 3)) + 50.0 * np.sin(
        3.0 * time + rng.uniform(0.0, 6.0, (1, MARKERS, 3))
    )
    positions[90:102] = np.nan
    group = root_group(positions, list(range(MARKERS)))
    assert group is not None
    contralateral = np.array([1, 0, 3, 2])
    windows = collect_windows(
        WindowSources(positions),
        np.arange(MARKERS),
        MirrorImage(contralateral, 0.95),
        90,
        layout(),
        group,
        OPTIONS,
    )
    own, image = windows.own, windows.own_image
    assert image.sum() == own.sum() - 1 > 10
    np.testing.assert_array_equal(own, ~image)
    assert set(windows.correlation[own]) == {1.0}
    assert set(windows.correlation[image]) == {0.95}
    between = windows.source_correlation()
    assert set(between[np.ix_(own, own)].ravel()) == {1.0}
    assert set(between[np.ix_(own, image)].ravel()) == {0.95}
    np.testing.assert_allclose(
        windows.inside[image], windows.inside[own][1:, :, contralateral] * [-1.0, 1.0, 1.0]
    )


def test_edge_features_are_distances_covered_by_velocity_and_acceleration() -> None:
    """A marker group before the blackout: at rest, at 200 mm/s, and accelerating by 2 m/s²."""
    rng = np.random.default_rng(0)
    pose = rng.normal(0.0, 200.0, (MARKERS, 3))
    group = root_group(pose[None], list(range(MARKERS)))
    assert group is not None
    time = -OPTIONS.difference_seconds * np.arange(3)  # the nearest frame first
    motion = np.stack([0.0 * time, 200.0 * time, 0.5 * 2000.0 * time**2])
    poses = pose + motion[:, :, None, None] * np.array([0.0, 0.0, 1.0])
    features = edge_features(poses, [3], group, OPTIONS)[0].reshape(3, 3, MARKERS, 3)
    np.testing.assert_allclose(features[1:, 0], features[:1, 0].repeat(2, axis=0), atol=1e-9)
    np.testing.assert_allclose(features[0, 1:], 0.0, atol=1e-9)
    # 0.15 s at 200 mm/s; 0.1² s² at 2 m/s²
    np.testing.assert_allclose(features[1, 1], np.tile([0.0, 0.0, 30.0], (MARKERS, 1)), atol=1e-9)
    np.testing.assert_allclose(features[1, 2], 0.0, atol=1e-9)
    np.testing.assert_allclose(features[2, 2], np.tile([0.0, 0.0, 20.0], (MARKERS, 1)), atol=1e-9)


def test_windows_of_the_database_keep_their_distance() -> None:
    """Windows that begin less than 5 frames from a better one are left out."""
    rows = np.array([100, 104, 105, 300, 98, 95])
    take, spacing = np.zeros(6, dtype=np.intp), np.full(6, 5.0)
    assert rows[spaced_rows(rows, take, spacing, 10)].tolist() == [100, 105, 300, 95]
    assert rows[spaced_rows(rows, take, spacing, 2)].tolist() == [100, 105]
    # those of another take are another movement
    take[1] = 1
    assert rows[spaced_rows(rows, take, spacing, 10)].tolist() == [100, 104, 105, 300, 95]


def test_all_of_a_take_or_of_a_subject_is_left_out() -> None:
    """Two takes of subject 0 and one of subject 1; the first window is the blackout."""
    source = FIRST_TAKE + np.array([0, 0, 0, 1, 1, 2])
    subject = np.array([0, 0, 0, 0, 0, 1])
    edges, rotation = np.zeros((6, 1)), about_vertical(np.zeros(6))
    inside = np.zeros((6, INSIDE, MARKERS, 3))

    def left_out(subject: np.ndarray) -> list[list[int]]:
        windows = windows_of(edges, inside, rotation, source, subject)
        return [block.tolist() for block in _left_out_together(windows, np.array([0, 4]), 10)]

    assert left_out(subject) == [[0, 1, 2, 3], [4]]
    # the clip's own subject is among the takes: others may be predicted from theirs as well
    assert left_out(np.where(subject == 1, THIS_CLIP, subject)) == [[0, 1], [4]]


def test_windows_of_the_database_count_by_the_distance_of_their_edges() -> None:
    count = 1 + 40
    edges = np.arange(count, dtype=float)[:, None]
    source = np.full(count, FIRST_TAKE)
    rotation = about_vertical(np.zeros(count))
    inside = np.zeros((count, INSIDE, MARKERS, 3))
    near = windows_of(edges, inside, rotation, source, source).nearness(OPTIONS)
    # of the 20th nearest window
    np.testing.assert_allclose(near, 1.0 / (1.0 + (np.arange(1, count) / 20.0) ** 4))
    np.testing.assert_array_equal(windows_of(edges, inside, rotation).nearness(OPTIONS), 1.0)


def test_the_expected_error_grows_with_the_distance_from_all_windows() -> None:
    rng = np.random.default_rng(4)
    count = 1 + 40
    edges = rng.normal(0.0, 20.0, (count, 6))
    curves = rng.normal(0.0, 10.0, (3, count, INSIDE, MARKERS, 3))
    inside = rng.normal(0.0, 10.0, (count, INSIDE, MARKERS, 3))
    source = FIRST_TAKE + np.arange(count)
    found = []
    for away in (0.0, 300.0):
        edges[0] = away
        windows = windows_of(edges, inside, about_vertical(np.zeros(count)), source, source)
        found.append(
            _from_windows(windows, lambda part: curves[:, part], len(curves), layout(), OPTIONS)[1]
        )
    assert found[1].mean() > 1.3 * found[0].mean()


def test_a_body_at_rest_in_the_database_smooths_a_clip_at_rest() -> None:
    """Noise of 1 mm around a constant pose, which curves through every sample continue."""
    rng = np.random.default_rng(6)
    pose = rng.normal(0.0, 200.0, (MARKERS, 3))
    clip = pose + rng.normal(0.0, 1.0, (45, MARKERS, 3))
    clip[15:30] = np.nan
    takes = SimpleNamespace(
        rows=np.arange(60),
        take=np.arange(60),
        subject=np.arange(60),
        correlation=np.ones(60),
        positions=lambda frames, markers: (
            pose[markers] + rng.normal(0.0, 1.0, (60, len(frames), len(markers), 3))
        ),
    )

    def error(options: BlackoutOptions) -> float:
        found = predict_blackout(
            WindowSources(clip, (cast(DatabaseWindows, takes),)),
            15,
            30,
            30.0,
            lambda among: root_group(clip, [int(m) for m in among]),
            MirrorImage(np.full(MARKERS, -1), 0.95),
            np.arange(MARKERS),
            options,
        )
        assert found is not None
        return float(np.linalg.norm(found.positions - pose, axis=2).mean())

    assert error(OPTIONS) < 0.85 * error(replace(OPTIONS, rest_processes=()))


def test_noise_like_the_clips_is_added_to_windows_of_the_database() -> None:
    rng = np.random.default_rng(0)
    context = np.zeros((1 + 200, 12, MARKERS, 3)) + np.arange(12)[:, None, None] ** 2
    context += rng.normal(0.0, 0.2, context.shape)
    context[0] += rng.normal(0.0, 0.8, context[0].shape)
    of_takes = np.arange(201) > 100
    found = match_noise(context, of_takes, layout())
    np.testing.assert_array_equal(found[~of_takes], context[~of_takes])
    assert 0.6 < (found - context)[of_takes].std() < 1.0  # 0.8 mm
    smooth = context.copy()
    smooth[0] = smooth[1]
    assert (match_noise(smooth, of_takes, layout()) - smooth).std() < 0.1


def test_other_subjects_are_brought_to_the_clips_size() -> None:
    rng = np.random.default_rng(2)
    # two segments of five markers, one of which moves relative to the other
    shape = rng.uniform(-200.0, 200.0, (10, 3))
    clip = np.repeat(shape[None], 30, axis=0)
    clip[:, 5:] += rng.normal(0.0, 100.0, (30, 1, 3))
    body = constant_distances(clip)
    taller = 1.1 * clip[:10] + rng.normal(0.0, 2.0, (10, 10, 3))
    same = clip[10:20] + rng.normal(0.0, 0.5, (10, 10, 3))
    scale, own = compare_sizes(body, np.concatenate([taller, same]), np.repeat([4, 7], 10))
    np.testing.assert_allclose(scale[:10], 1.0 / 1.1, rtol=0.02)
    np.testing.assert_array_equal(scale[10:], 1.0)
    assert own.tolist() == [False] * 10 + [True] * 10


def test_a_correction_begins_and_ends_without_a_jump_or_a_bend() -> None:
    correction = np.array([5.0, -3.0, 8.0])
    near = np.array([-1.0, -0.99, 11.99, 12.0])  # frames; the edges are at -1 and 12
    both = interpolate_correction(layout(), correction, near)
    np.testing.assert_allclose(both, 0.0, atol=1e-3)
    np.testing.assert_allclose(
        interpolate_correction(layout(), correction, layout().inside), correction
    )
    one_sided = replace(layout(), after=np.arange(0))
    before, after = interpolate_correction(one_sided, correction, near)[[1, 3]]
    assert abs(before) < 1e-3
    assert abs(after) > 5.0


# --- without windows ---


def test_the_expected_error_without_windows_grows_with_the_distance_covered() -> None:
    """At 240 mm/s; the first 0.25 s are predictable, and the curves agree."""
    rate = 20.0
    frames = WindowLayout(
        frames=20,
        before=np.arange(-3, 0),
        after=np.arange(20, 23),
        inside=np.array([2, 9, 10, 17]),
        step=1,
    )
    context = frames.context[:, None, None] * np.array([12.0, 0.0, 0.0])
    curves = np.zeros((3, 1, 4, 1, 3))
    found = _error_without_windows(curves, context, frames, rate, OPTIONS)[:, 0]
    beyond = np.array([0.0, 0.25, 0.25, 0.0])  # s from the nearer edge, without 0.25 s
    np.testing.assert_allclose(found, np.hypot(240.0, 100.0) * beyond, atol=1e-9)


# --- segments ---


def test_segments_shorter_than_the_blackout_are_joined_to_their_own_edges() -> None:
    """Samples at both edges of a segment that are 70 mm off move its prediction as much."""
    truth = person(rate=30.0)
    labels = truth.labels
    clip = with_gaps(truth, (50, 60, labels[1:]), (53, 57, labels[:1]))
    task = Task(clip.positions, labels, clip.rate, describe(clip), (), ())
    predictor = BlackoutPredictor(
        task,
        PoseSearch(task, SearchOptions()),
        OPTIONS,
        SubjectCorrelationOptions(),
        InterpolationOptions(),
    )
    nothing = np.array([], dtype=np.intp)
    first, rest = np.array([0]), np.arange(1, len(labels))
    segments = [GapSegment(rest, 50, 60, nothing), GapSegment(first, 53, 57, nothing)]
    moved = clip.positions.copy()
    moved[[52, 57], 0] += [70.0, 0.0, 0.0]
    before, after = (predictor.predict(segments, given) for given in (clip.positions, moved))
    for one, other, offset in zip(before, after, (0.0, 70.0), strict=True):
        expected = one.positions + np.array([offset, 0.0, 0.0])
        np.testing.assert_allclose(other.positions, expected, atol=1e-9)
    # continuous at the edges: less than a marker moves in two frames
    step = np.linalg.norm(np.diff(truth.positions[50:60, 0], axis=0), axis=1).max()
    assert np.linalg.norm(before[1].positions[0, 0] - clip.positions[52, 0]) < 2.0 * step

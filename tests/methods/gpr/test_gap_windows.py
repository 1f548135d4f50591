"""Limbs from windows of the database that are as long as the gap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from priorfill.clip import Clip
from priorfill.gaps import gap_groups
from priorfill.gp.ensemble import Regression
from priorfill.markers.describe import describe
from priorfill.methods.gpr import gpr_fill
from priorfill.methods.gpr.gap_segments import GapSegment
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.sources.combine import combined
from priorfill.methods.gpr.sources.gap_layout import lay_out_gap
from priorfill.methods.gpr.sources.gap_windows import GapWindows
from priorfill.methods.gpr.sources.options import GapWindowOptions
from priorfill.methods.gpr.sources.source import SourcePrediction
from priorfill.methods.gpr.sources.window_regression import regress_windows
from priorfill.methods.task import Task
from priorfill.search import bank as bank_module
from priorfill.search.bank import PoseBank
from priorfill.search.takes import same_subject_take

OPTIONS = GapWindowOptions()
RATE = 30.0
FRAMES = 60
GAP = slice(20, 40)
LIMB = np.array([0, 1])
BODY = np.arange(2, 10)


def raised(seed: int) -> np.ndarray:
    """A limb of two markers that is raised and lowered once, while the body hardly moves.

    How far is seen by its velocity at the edges of the gap alone.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(FRAMES) / RATE
    positions = np.tile(np.random.default_rng(1).normal(0.0, 200.0, (10, 3)), (FRAMES, 1, 1))
    height = rng.uniform(100.0, 500.0)
    bump = np.sin(np.pi * time / time[-1])
    positions[:, LIMB, 2] += (height * bump**2)[:, None] * [1.0, 0.7]
    positions[:, LIMB, 0] -= (0.3 * height * bump**4)[:, None]
    positions[:, BODY] += rng.normal(0.0, 3.0, (len(BODY), 3))
    positions[:, 5:7] += 10.0 * np.sin(time + rng.normal())[:, None, None]
    turn = rng.uniform(0.0, 2.0 * np.pi)
    rotation = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    return positions @ rotation.T + rng.normal(0.0, 0.2, positions.shape)


def task_of(seeds: range, stop: int = GAP.stop) -> tuple[Task, GapSegment, np.ndarray]:
    """A clip of such a movement, with a gap of the limb, and takes of others; and the truth."""
    labels = tuple(f"M{i}" for i in range(10))
    truth = raised(0)
    gappy = truth.copy()
    gappy[GAP.start : stop, LIMB] = np.nan
    clip = Clip(gappy, labels, RATE, subject="S")
    takes = tuple(
        same_subject_take(replace(Clip(raised(seed), labels, RATE), name=f"t{seed}"), labels)
        for seed in seeds
    )
    groups = tuple(gap_groups(clip.missing))
    task = Task(gappy, labels, RATE, describe(clip), groups, takes, "clip", "S")
    return task, GapSegment(LIMB, GAP.start, stop, BODY), truth[GAP.start : stop, LIMB]


def predicted(seeds: range, stop: int = GAP.stop) -> tuple[SourcePrediction | None, np.ndarray]:
    task, segment, truth = task_of(seeds, stop)
    options = GPROptions()
    windows = GapWindows(task, PoseSearch(task, options.search), OPTIONS, 15.0)
    return windows.predict(segment, BODY), truth


def test_a_limb_that_moves_once_is_predicted_by_its_edges() -> None:
    found, truth = predicted(range(1, 40))
    assert found is not None
    error = np.linalg.norm(found.positions - truth, axis=-1)
    u = np.linspace(0.0, 1.0, len(truth) + 2)[1:-1, None, None]
    line = (1.0 - u) * truth[:1] + u * truth[-1:]
    assert error.mean() < 0.15 * np.linalg.norm(line - truth, axis=-1).mean()
    rms = np.sqrt((error**2).mean())
    assert 0.5 * rms < np.sqrt((found.expected_rms**2).mean()) < 3.0 * rms
    assert set(found.takes) <= {f"t{seed}" for seed in range(1, 40)}


def test_a_gap_at_the_end_of_a_clip_has_one_edge() -> None:
    found, truth = predicted(range(1, 40), FRAMES)
    assert found is not None
    error = np.linalg.norm(found.positions - truth, axis=-1).mean()
    assert error < 0.3 * np.linalg.norm(truth - truth[:1], axis=-1).mean()


def test_few_windows_predict_nothing() -> None:
    assert predicted(range(1, 3))[0] is None
    assert predicted(range(0))[0] is None


@pytest.mark.parametrize(("start", "stop"), [(20, 24), (0, 60)])
def test_gaps_without_edges_and_short_ones_are_left_out(start: int, stop: int) -> None:
    valid = np.ones((60, 10), dtype=bool)
    valid[start:stop, 0] = False
    segment = GapSegment(np.array([0]), start, stop, BODY)
    assert lay_out_gap(segment, valid, RATE, OPTIONS) is None


def test_the_fill_uses_them() -> None:
    task, _, truth = task_of(range(1, 40))
    none = GPROptions(gap_windows=GapWindowOptions(max_windows=0))
    errors = [
        np.linalg.norm(
            gpr_fill.fill(task, options=options).positions[GAP, LIMB] - truth, axis=-1
        ).mean()
        for options in (GPROptions(), none)
    ]
    assert errors[0] < 0.7 * errors[1]


def test_groups_are_held_out_as_by_a_regression_without_them() -> None:
    rng = np.random.default_rng(3)
    features, targets = rng.normal(size=(30, 4)), rng.normal(size=(30, 5))
    groups = np.repeat(np.arange(10), 3)
    found = regress_windows(features, targets, features[0], groups, OPTIONS)
    # the regression's own scale and length, from all windows
    centred = features - features.mean(axis=0)
    scale = np.sqrt((centred**2).sum(axis=1).mean())
    square = ((centred[:, None] - centred) ** 2).sum(axis=2) / scale**2
    others = np.sort(np.where(groups[:, None] == groups, np.inf, square), axis=1)[:, 5]
    length = OPTIONS.length_scale * np.sqrt(np.median(others))
    covariance = np.exp(-0.5 * square / length**2)
    covariance += OPTIONS.linear * centred @ centred.T / scale**2
    for group in range(10):
        rest = groups != group
        noisy = covariance[np.ix_(rest, rest)] + OPTIONS.noise_variance * np.eye(rest.sum())
        weights = np.linalg.solve(noisy, covariance[np.ix_(rest, ~rest)])
        np.testing.assert_allclose(
            found.residuals[~rest], targets[~rest] - weights.T @ targets[rest], rtol=1e-6
        )
    np.testing.assert_allclose(found.similarity.sum(), 1.0)


def test_predictions_are_weighted_by_their_errors() -> None:
    regression = Regression(np.zeros((6, 1, 3)), np.full((6, 1), 2.0), 1.6)
    source = SourcePrediction(np.ones((4, 1, 3)), np.full((4, 1), 0.5), 2.0, ("t",))
    found, weight = combined(regression, source, 1, power=2.0)
    assert weight == pytest.approx(0.8)
    np.testing.assert_allclose(found.positions[1:5], 0.8)
    np.testing.assert_array_equal(found.positions[[0, 5]], 0.0)
    np.testing.assert_allclose(found.expected_rms[1:5], np.sqrt(0.8 * 0.25 + 0.2 * 4.0))


@pytest.mark.parametrize("max_brute_force", [0, 10_000])
def test_distances_of_all_poses_of_a_bank(
    max_brute_force: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bank_module, "MAX_BRUTE_FORCE_POSES", max_brute_force)
    monkeypatch.setattr(bank_module, "ROWS_PER_PRODUCT", 50)
    task, _, _ = task_of(range(1, 6))
    root = task.root_among(BODY)
    assert root is not None
    bank = PoseBank(task.takes, root, BODY, LIMB, 15.0)
    markers, chosen = np.array([3, 6]), bank.rows[[4, 40]]
    everything = np.full((bank.poses, 10, 3), np.nan)
    some = np.arange(10)
    everything[:] = bank.positions(np.arange(bank.poses), some)
    local = root.frames(everything).to_local(everything)
    found = bank.squared_distances(markers, local[np.ix_(chosen, markers)])
    expected = ((local[bank.rows][:, None, markers] - local[chosen][:, markers]) ** 2).sum(-1)
    np.testing.assert_allclose(found, expected.mean(axis=-1), rtol=1e-3, atol=2.0)

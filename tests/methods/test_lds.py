"""The linear dynamical system: exact inference, increasing likelihood, recovered motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gappy import ARM, error, fill_unchecked, person, with_gaps
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.clip import Clip
from priorfill.gaps import gap_groups
from priorfill.markers.describe import describe
from priorfill.methods import lds
from priorfill.methods.task import Task


def model(rng, k, d, decay=0.9):
    """A stable random system."""
    turn, _ = np.linalg.qr(rng.normal(size=(k, k)))
    root = rng.normal(size=(k, k))
    return lds.LdsModel(
        decay * turn,
        rng.normal(size=(d, k)),
        root @ root.T / k + 0.1 * np.eye(k),
        rng.uniform(0.1, 2.0, d),
        rng.normal(size=k),
        np.eye(k) * 2.0,
    )


def draw(rng, system, frames):
    """Observations of the system, with and without noise."""
    k, d = len(system.start), len(system.noise)
    hidden = np.empty((frames, k))
    hidden[0] = rng.multivariate_normal(system.start, system.start_covariance)
    for t in range(1, frames):
        hidden[t] = rng.multivariate_normal(system.transition @ hidden[t - 1], system.process)
    clean = hidden @ system.emission.T
    return clean + rng.normal(size=(frames, d)) * np.sqrt(system.noise), clean


def dense(system, observed):
    """Posterior mean and covariance of all states, and the likelihood, from one joint Gaussian."""
    frames = len(observed)
    k = len(system.start)
    mean, covariance = np.zeros((frames, k)), np.zeros((frames, frames, k, k))
    mean[0], covariance[0, 0] = system.start, system.start_covariance
    for t in range(1, frames):
        mean[t] = system.transition @ mean[t - 1]
        for s in range(t):
            covariance[t, s] = system.transition @ covariance[t - 1, s]
            covariance[s, t] = covariance[t, s].T
        covariance[t, t] = (
            system.transition @ covariance[t - 1, t - 1] @ system.transition.T + system.process
        )
    prior = covariance.transpose(0, 2, 1, 3).reshape(frames * k, frames * k)
    show = np.kron(np.eye(frames), system.emission)
    seen = ~np.isnan(observed.ravel())
    show, noise = show[seen], np.tile(system.noise, frames)[seen]
    total = show @ prior @ show.T + np.diag(noise)
    off = observed.ravel()[seen] - show @ mean.ravel()
    gain = prior @ show.T @ np.linalg.inv(total)
    _, determinant = np.linalg.slogdet(total)
    likelihood = -0.5 * (
        len(off) * np.log(2 * np.pi) + determinant + off @ np.linalg.solve(total, off)
    )
    posterior = (prior - gain @ show @ prior).reshape(frames, k, frames, k)
    return (mean.ravel() + gain @ off).reshape(frames, k), posterior, likelihood


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 3),
    st.integers(1, 5),
    st.integers(1, 9),
    st.floats(0, 0.9),
)
def test_the_smoother_is_the_exact_posterior(seed, k, d, frames, missing):
    rng = np.random.default_rng(seed)
    system = model(rng, k, d)
    observed, _ = draw(rng, system, frames)
    observed[rng.random(observed.shape) < missing] = np.nan
    visible = lds.Observations(observed)
    found = lds.smooth(system, visible)
    mean, posterior, likelihood = dense(system, observed)
    np.testing.assert_allclose(found.means, mean, atol=1e-7)
    np.testing.assert_allclose(found.likelihood, likelihood, rtol=1e-8, atol=1e-7)
    np.testing.assert_allclose(found.first, posterior[0, :, 0], atol=1e-7)
    np.testing.assert_allclose(found.last, posterior[-1, :, -1], atol=1e-7)
    of_frame = np.array([posterior[t, :, t] for t in range(frames)])
    sums = [of_frame[visible.which == p].sum(axis=0) for p in range(len(visible.patterns))]
    np.testing.assert_allclose(found.covariances, sums, atol=1e-7)
    lagged = sum((posterior[t, :, t - 1] for t in range(1, frames)), np.zeros((k, k)))
    np.testing.assert_allclose(found.lagged, lagged, atol=1e-7)


def test_covariances_that_have_settled_are_still_exact():
    rng = np.random.default_rng(5)
    system = model(rng, 2, 3, decay=0.7)
    observed, _ = draw(rng, system, 90)
    observed[40:60, 0] = np.nan
    found = lds.smooth(system, lds.Observations(observed))
    mean, posterior, likelihood = dense(system, observed)
    np.testing.assert_allclose(found.means, mean, atol=1e-6)
    np.testing.assert_allclose(found.likelihood, likelihood, rtol=1e-8)
    total = sum(posterior[t, :, t] for t in range(90))
    np.testing.assert_allclose(found.covariances.sum(axis=0), total, atol=1e-6)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0, 0.5))
def test_learning_never_lowers_the_likelihood(seed, missing):
    rng = np.random.default_rng(seed)
    observed, _ = draw(rng, model(rng, 3, 6), 60)
    hidden = rng.random(observed.shape) < missing
    hidden[:2] = False  # no column of nothing else
    observed[hidden] = np.nan
    visible, least = lds.Observations(observed), 1e-4
    system = lds.initial_model(observed, 3, least)
    before = lds.smooth(system, visible)
    for _ in range(12):
        system = lds._maximise(before, visible, least)
        after = lds.smooth(system, visible)
        assert after.likelihood >= before.likelihood - 1e-7 * abs(before.likelihood)
        before = after


def test_a_motion_of_the_system_is_recovered():
    rng = np.random.default_rng(2)
    turn = 2 * np.pi / np.array([37.0, 61.0])
    blocks = np.zeros((4, 4))
    for i, angle in enumerate(turn):
        c, s = np.cos(angle), np.sin(angle)
        blocks[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[c, -s], [s, c]]
    start = np.array([300.0, 0.0, 0.0, 200.0])
    system = lds.LdsModel(
        blocks, rng.normal(size=(18, 4)), np.eye(4), np.full(18, 0.25), start, np.eye(4)
    )
    observed, clean = draw(rng, system, 400)
    removed = np.zeros(observed.shape, dtype=bool)
    removed[100:170, :6] = removed[250:270] = removed[380:, 6:9] = True
    observed[removed] = np.nan
    found, smoothed = lds.fit(observed, lds.LdsOptions(hidden_dimensions=4, max_iterations=30))
    off = smoothed.means @ found.emission.T - clean
    assert np.sqrt((off[100:170, :6] ** 2).mean()) < 0.6  # next to visible markers: the noise
    assert np.sqrt((off[removed] ** 2).mean()) < 20.0  # a blackout of 20 frames, moving by 600 mm
    np.testing.assert_allclose(
        np.sort(abs(np.angle(np.linalg.eigvals(found.transition))))[::2], np.sort(turn), rtol=0.02
    )


def test_gaps_of_a_person_are_filled():
    truth = person()
    clip = with_gaps(truth, (80, 110, ARM), (150, 160, truth.labels), (0, 240, ("C7",)))
    result = fill_unchecked(clip, method="lds")
    assert result.filled[:, [i for i, x in enumerate(clip.labels) if x != "C7"]].sum() == (
        clip.missing.sum() - 240
    )
    assert error(result.clip.positions, truth.positions, result.filled) < 60.0
    (left,) = [gap for gap in result.gaps if gap.unfilled]
    assert left.label == "C7"
    assert "never visible" in left.unfilled[0].reason


@pytest.mark.parametrize("frames", [1, 2, 3])
@pytest.mark.parametrize("markers", [1, 2, 5])
def test_small_clips(frames, markers):
    truth = person()
    clip = replace(
        truth, positions=truth.positions[:frames, :markers], labels=truth.labels[:markers]
    )
    clip = with_gaps(clip, (frames // 2, frames // 2 + 1, clip.labels[:1]))
    assert fill_unchecked(clip, method="lds").complete == (frames > 1)


def test_clips_that_do_not_move():
    still = np.repeat(person().positions[:1], 60, axis=0)
    for positions in (still, np.repeat(still[:, :1], 41, axis=1)):
        clip = with_gaps(replace(person(), positions=positions), (20, 40, ARM))
        found = fill_unchecked(clip, method="lds").clip.positions
        np.testing.assert_allclose(found, positions, atol=0.1)


def test_it_turns_and_moves_with_the_clip():
    clip = with_gaps(person(), (80, 110, ARM))
    angle = 0.7
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    moved = clip.with_positions(clip.positions @ turn + [500.0, -200.0, 0.0])
    options = lds.LdsOptions(max_iterations=5)
    found = []
    for each in (clip, moved):
        groups = tuple(gap_groups(each.missing))
        task = Task(each.positions, each.labels, each.rate, describe(each), groups)
        found.append(lds.fill(task, options=options).positions)
    # R is diagonal along the axes, so a rotation of the clip has a small effect
    off = np.linalg.norm(found[1] - (found[0] @ turn + [500.0, -200.0, 0.0]), axis=2)
    assert off.max() < 10.0


def test_diverging_samples_stay_missing(monkeypatch):
    """A growing oscillation continues to grow."""
    monkeypatch.setattr(lds, "MAX_EXCURSION", 100.0)
    frames = 400
    time = np.arange(frames)[:, None]
    positions = np.zeros((frames, 4, 3))
    positions[:, :, 0] = 5.0 * np.exp(0.02 * time) * np.sin(0.2 * time + np.arange(4))
    positions += np.random.default_rng(0).normal(0.0, 0.5, positions.shape)
    whole = Clip(positions, ("A", "B", "C", "D"), 100.0)
    clip = with_gaps(whole, (150, frames, whole.labels))
    result = fill_unchecked(clip, method="lds")
    found, seen = result.clip.positions[150:], positions[:150]
    assert not (found > seen.max(axis=0) + 100.0).any()
    assert not (found < seen.min(axis=0) - 100.0).any()
    assert not result.complete
    gap = result.gaps[0]
    assert gap.filled
    assert all("diverges by more than a metre" in part.reason for part in gap.unfilled)


def test_coordinates_that_hardly_vary_and_others_that_vary_by_metres():
    """Rounding makes matrices indefinite or singular that are neither."""
    rng = np.random.default_rng(1)
    for scale in (1.0, 1e4, 1e6):
        positions = np.repeat(rng.normal(0.0, 1000.0, (1, 8, 3)), 30, axis=0)
        positions[:, 0] += scale * np.arange(30.0)[:, None] ** 2
        positions[rng.random((30, 8)) < 0.9] = np.nan
        clip = Clip(positions, tuple("ABCDEFGH"), 1000.0)
        result = fill_unchecked(clip, method="lds")
        assert np.isfinite(result.clip.positions[result.filled]).all()


def test_factors_of_matrices_that_rounding_made_indefinite():
    factor, determinant = lds._factor(np.diag([4.0, 1.0, -1e-9]), 1.0)
    np.testing.assert_allclose(factor @ factor.T, np.diag([4.0, 1.0, 1.0]), atol=1e-12)
    np.testing.assert_allclose(determinant, np.log(4.0))
    singular = np.diag([2.0, 0.0])
    np.testing.assert_allclose(lds._solved(singular, np.array([4.0, 0.0])), [2.0, 0.0])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("growth", [1e60, 1e200])
def test_states_that_overflow_are_left_missing(monkeypatch, growth):
    initial = lds.initial_model

    def unstable(*arguments):
        found = initial(*arguments)
        return replace(found, transition=growth * np.eye(len(found.transition)))

    monkeypatch.setattr(lds, "initial_model", unstable)
    positions = np.random.default_rng(0).normal(0.0, 100.0, (12, 4, 3))
    whole = Clip(positions, ("A", "B", "C", "D"), 100.0)
    clip = with_gaps(whole, (3, 12, whole.labels))
    result = fill_unchecked(clip, method="lds")
    assert not result.filled.any()
    assert {span.reason for gap in result.gaps for span in gap.unfilled} == {lds.DIVERGED}

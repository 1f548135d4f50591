from dataclasses import fields

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_priors import random_prior

from priorfill.energy.targets import Prior, fold, to_world
from priorfill.energy.terms import banded_system, energy, gradient
from priorfill.geometry.root_frames import RootFrames

seeds = st.integers(0, 2**31)


@settings(deadline=None)
@given(seeds, st.integers(3, 12), st.integers(1, 3), st.integers(1, 5))
def test_energy_is_that_of_the_paper(seed, frames, markers, k):
    rng = np.random.default_rng(seed)
    missing = rng.random((frames, markers)) < 0.6
    x = rng.normal(0, 100, (frames, markers, 3))
    votes = [rng.normal(0, 100, (frames, k, markers, 3)) for _ in range(3)]
    weights = rng.uniform(0, 2, (frames, k))
    folded = [fold(v, weights) for v in votes]
    weight = np.where(missing, folded[0][1], 0.0)
    inner = weight.copy()
    inner[[0, -1]] = 0.0
    constant = np.where(weight > 0, folded[0][2], 0) + np.where(
        inner > 0, folded[1][2] + folded[2][2], 0
    )
    prior = Prior(*(f[0] for f in folded), weight, inner, inner, constant)
    expected = naive.energy(x, missing, *votes, weights)
    assert energy(x, prior) == pytest.approx(expected, rel=1e-9, abs=1e-6)


def test_fold_ignores_neighbours_without_the_marker():
    values = np.array([[[[0.0, 0, 0]], [[4.0, 0, 0]], [[np.nan] * 3]]])  # (1, 3, 1, 3)
    mean, weight, constant = fold(values, np.array([[3.0, 1.0, 7.0]]))
    np.testing.assert_allclose(mean, [[[1.0, 0, 0]]])
    np.testing.assert_allclose(weight, [[4.0]])
    np.testing.assert_allclose(constant, [[3 * 1 + 1 * 9.0]])


@given(seeds, st.integers(3, 9), st.integers(1, 3))
def test_gradient_is_that_of_finite_differences(seed, frames, markers):
    rng = np.random.default_rng(seed)
    prior = random_prior(rng, frames, markers)
    x = rng.normal(0, 50, (frames, markers, 3))
    slope = gradient(x, prior)
    step = 1e-2
    for _ in range(5):
        at = tuple(rng.integers(x.shape))
        up, down = x.copy(), x.copy()
        up[at] += step
        down[at] -= step
        expected = (energy(up, prior) - energy(down, prior)) / (2 * step)
        assert slope[at] == pytest.approx(expected, rel=1e-5, abs=1e-3)


@given(seeds, st.integers(3, 9), st.integers(1, 3))
def test_the_banded_system_is_the_energy_as_a_quadratic_form(seed, frames, markers):
    rng = np.random.default_rng(seed)
    prior = random_prior(rng, frames, markers)
    prior.velocity_weight[[0, -1]] = prior.acceleration_weight[[0, -1]] = 0
    system = banded_system(prior)
    x = rng.normal(0, 50, (frames, markers, 3))
    slope = gradient(x, prior)
    for m in range(markers):
        A = np.diag(system.diagonal[m])
        A += np.diag(system.off1[m, :-1], 1) + np.diag(system.off1[m, :-1], -1)
        A += np.diag(system.off2[m, :-2], 2) + np.diag(system.off2[m, :-2], -2)
        np.testing.assert_allclose(
            2 * (A @ x[:, m] - system.rhs[m].T), slope[:, m], rtol=1e-9, atol=1e-6
        )


def test_targets_are_transformed_with_the_root_frames():
    rng = np.random.default_rng(6)

    def frames(angle, shift):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        return RootFrames(np.array([shift]), turn[None])

    before, here, after = frames(0.1, [0, 0, 0]), frames(0.2, [5, 0, 0]), frames(0.3, [11.0, 0, 0])
    path = rng.normal(0, 100, (3, 1, 2, 3))  # poses in root frames before, here and after
    pose, velocity = path[1], (path[2] - path[0]) / 2
    acceleration = path[2] - 2 * path[1] + path[0]
    world = [f.to_world(p) for f, p in zip((before, here, after), path, strict=True)]
    found = to_world(pose, velocity, acceleration, before, here, after)
    np.testing.assert_allclose(found[0], world[1])
    np.testing.assert_allclose(found[1], (world[2] - world[0]) / 2)
    np.testing.assert_allclose(found[2], world[2] - 2 * world[1] + world[0])


def test_a_part_is_copied_into_a_prior():
    rng = np.random.default_rng(7)
    rows, columns = np.array([4, 1]), np.array([2, 0, 3])
    prior, expected = Prior.empty(6, 5), Prior.empty(6, 5)
    for field in fields(prior):
        assert not getattr(prior, field.name).any()
    for _ in range(2):  # the second part replaces the first
        part = random_prior(rng, 2, 3)
        prior.place(rows, columns, part)
    for field in fields(prior):
        target, values = getattr(expected, field.name), getattr(part, field.name)
        for i, row in enumerate(rows):
            for j, column in enumerate(columns):
                target[row, column] = values[i, j]
        np.testing.assert_array_equal(getattr(prior, field.name), target)

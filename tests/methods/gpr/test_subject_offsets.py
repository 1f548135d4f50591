"""Constant offsets of other subjects."""

from __future__ import annotations

import numpy as np
import pytest

from priorfill.methods.gpr.training.subject_offsets import SHRINKAGE_POSES, subject_offsets


def swing(time):
    """An arm of three markers that swings (poses, 3, 3)."""
    angle = np.sin(2.0 * np.pi * time)
    along = np.stack([np.sin(angle), np.zeros_like(angle), -np.cos(angle)], axis=1)
    return np.array([100.0, 250.0, 400.0])[None, :, None] * along[:, None]


def test_constant_offsets_are_estimated():
    own = swing(np.linspace(0, 1, 200))
    offset = np.array([[10.0, -4.0, 2.0], [5.0, 8.0, -3.0], [0.0, 6.0, 9.0]])
    subject = np.repeat([3, 8], 60)
    others = swing(np.linspace(0, 1, 120)) - np.where(subject[:, None, None] == 3, offset, -offset)
    found = subject_offsets(own, others, subject)
    shrinkage = 60 / (60 + SHRINKAGE_POSES)
    # across the swing; along it, an offset is indistinguishable from another phase
    for number, sign in ((3, 1.0), (8, -1.0)):
        across = found[subject == number][..., 1]
        np.testing.assert_allclose(
            across, np.broadcast_to(sign * shrinkage * offset[:, 1], (60, 3))
        )

    def apart(poses):
        return np.mean([np.sqrt(((own - x) ** 2).sum(axis=(1, 2))).min() for x in poses])

    assert apart(others + found) < 0.4 * apart(others)


def test_offsets_are_mean_differences_from_the_nearest_poses():
    """Against comparing every pose with every other, one round after another."""
    rng = np.random.default_rng(2)
    own, others = rng.normal(0, 50, (30, 2, 3)), rng.normal(20, 50, (7, 2, 3))
    offset = np.zeros((2, 3))
    for _ in range(3):
        nearest = [min(own, key=lambda x, y=y: ((x - y - offset) ** 2).sum()) for y in others]
        offset = (
            np.mean([x - y for x, y in zip(nearest, others, strict=True)], axis=0)
            * 7
            / (7 + SHRINKAGE_POSES)
        )
    np.testing.assert_allclose(subject_offsets(own, others, np.zeros(7, dtype=int))[0], offset)


@pytest.mark.parametrize("poses", [1, 5])
def test_offsets_of_few_poses_are_small(poses):
    others = np.full((poses, 1, 3), 10.0)
    found = subject_offsets(np.zeros((4, 1, 3)), others, np.zeros(poses, dtype=int))
    np.testing.assert_allclose(found, -10.0 * poses / (poses + SHRINKAGE_POSES))

"""Other bodies fitted to the clip's."""

from __future__ import annotations

import numpy as np
import pytest

from priorfill.methods.gpr.training.subject_offsets import DOUBT, shifts


def swing(time):
    """An arm of three markers that swings (poses, 3, 3)."""
    angle = np.sin(2.0 * np.pi * time)
    along = np.stack([np.sin(angle), np.zeros_like(angle), -np.cos(angle)], axis=1)
    return np.array([100.0, 250.0, 400.0])[None, :, None] * along[:, None]


def test_what_a_body_is_always_off_by_is_found():
    own = swing(np.linspace(0, 1, 200))
    off = np.array([[10.0, -4.0, 2.0], [5.0, 8.0, -3.0], [0.0, 6.0, 9.0]])
    body = np.repeat([3, 8], 60)
    others = swing(np.linspace(0, 1, 120)) - np.where(body[:, None, None] == 3, off, -off)
    found = shifts(own, others, body)
    trust = 60 / (60 + DOUBT)
    # across the swing; along it, another body may just be earlier or later
    for number, sign in ((3, 1.0), (8, -1.0)):
        across = found[body == number][..., 1]
        np.testing.assert_allclose(across, np.broadcast_to(sign * trust * off[:, 1], (60, 3)))

    def apart(poses):
        return np.mean([np.sqrt(((own - x) ** 2).sum(axis=(1, 2))).min() for x in poses])

    assert apart(others + found) < 0.4 * apart(others)


def test_it_is_the_mean_of_what_the_nearest_say():
    """Against comparing every pose with every other, one round after another."""
    rng = np.random.default_rng(2)
    own, others = rng.normal(0, 50, (30, 2, 3)), rng.normal(20, 50, (7, 2, 3))
    off = np.zeros((2, 3))
    for _ in range(3):
        nearest = [min(own, key=lambda x, y=y: ((x - y - off) ** 2).sum()) for y in others]
        off = (
            np.mean([x - y for x, y in zip(nearest, others, strict=True)], axis=0) * 7 / (7 + DOUBT)
        )
    np.testing.assert_allclose(shifts(own, others, np.zeros(7, dtype=int))[0], off)


@pytest.mark.parametrize("poses", [1, 5])
def test_few_poses_shift_little(poses):
    others = np.full((poses, 1, 3), 10.0)
    found = shifts(np.zeros((4, 1, 3)), others, np.zeros(poses, dtype=int))
    np.testing.assert_allclose(found, -10.0 * poses / (poses + DOUBT))

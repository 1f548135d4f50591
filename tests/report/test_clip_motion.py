"""Measured motion that fills are compared with, on paths whose steps are known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from priorfill.report.clip_motion import AROUND_SECONDS, MAX_PARTNERS, ClipMotion, RigidPartner

FRAMES = 100


def motion(*speeds: float, **changes: Any) -> ClipMotion:
    """Markers on parallel lines, 10 mm apart, that move by a number of mm in each frame."""
    positions = np.zeros((FRAMES, len(speeds), 3))
    positions[..., 0] = np.arange(FRAMES)[:, None] * np.array(speeds)
    positions[..., 1] = 10.0 * np.arange(len(speeds))
    fields = {
        "positions": positions,
        "measured": np.ones(positions.shape[:2], dtype=bool),
        "filled": np.zeros(positions.shape[:2], dtype=bool),
        "segment": ("one",) * len(speeds),
        "contralateral": np.full(len(speeds), -1),
        "rate": 100.0,
    }
    return ClipMotion(**(fields | changes))


def test_the_greatest_step_is_that_of_both_sides() -> None:
    alone = motion(2.0, 5.0)
    assert alone.greatest(0, 1) == pytest.approx(2.0)
    assert alone.greatest(0, 2) == pytest.approx(0.0)
    both = motion(2.0, 5.0, contralateral=np.array([1, 0]))
    assert both.greatest(0, 1) == both.greatest(1, 1) == pytest.approx(5.0)
    none = motion(2.0, 5.0, measured=np.zeros((FRAMES, 2), dtype=bool))
    assert none.greatest(0, 1) == math.inf


def test_a_step_takes_a_hundredth_of_a_second() -> None:
    assert motion(2.0, rate=400.0).greatest(0, 1) == pytest.approx(8.0)
    assert motion(2.0, rate=30.0).greatest(0, 1) == pytest.approx(2.0)


def test_only_measured_samples_count() -> None:
    clip = motion(1.0, 1.0, 1.0)
    clip.positions[30:60:2, :, 0] += 70.0
    clip.positions[60:70, 1, 2] = -900.0
    assert clip.greatest(0, 1) > 60.0
    clip.measured[30:60] = clip.measured[60:70, 1] = False
    seen = motion(1.0, 1.0, 1.0, positions=clip.positions, measured=clip.measured)
    assert seen.greatest(0, 1) == pytest.approx(1.0)
    assert seen.around(0, 20, 40, 1) == pytest.approx(1.0)
    assert (seen.floor == 0.0).all()


def test_neighbours_show_how_a_part_of_the_body_moves() -> None:
    assert motion(50.0, 2.0, 3.0).around(0, 40, 50, 1) == pytest.approx(2.0)
    assert motion(50.0, 2.0).around(0, 40, 50, 1) == 0.0
    # the five nearest at the same time
    assert motion(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 9.0, 9.0).around(0, 0, 1, 1) == pytest.approx(1.0)
    clip = motion(0.0, 0.0, 0.0)
    reach = round(100 * AROUND_SECONDS)
    clip.positions[40 - reach + 1 :, :, 0] += 30.0
    assert clip.around(0, 40, 50, 1) == pytest.approx(30.0)
    assert clip.around(0, 42, 50, 1) == 0.0


def test_the_nearest_marker() -> None:
    clip = motion(0.0, 0.0, 0.0)
    assert clip.nearest_distance(1, 0, 10) == (10.0, 0)
    clip.positions[:5, 0] = np.nan
    clip.positions[5:, 2, 1] = 11.0
    assert clip.nearest_distance(1, 5, 10) == (1.0, 2)
    assert clip.nearest_distance(1, 0, 5) == (10.0, 2)


def test_partners_are_the_most_rigid_ones_of_the_segment() -> None:
    count = MAX_PARTNERS + 3
    clip = motion(*[0.0] * count, segment=(*["one"] * (count - 1), "two"))
    swing = np.where(np.arange(FRAMES) % 2, 1.0, -1.0)
    for other, spread in enumerate((5.0, 1.0, 2.0, 3.0, 4.0), start=1):
        clip.positions[:, other, 1] = 100.0 * other + spread * swing
    found = clip.partners(0)
    assert [one.marker for one in found] == [2, 3, 4, 5]
    assert found[0] == RigidPartner(2, 199.0, 201.0, pytest.approx(200.0))
    pair = motion(0.0, 0.0)
    for spread, partners in ((7.9, 1), (8.1, 0)):
        pair.positions[:, 1, 1] = 100.0 + spread * swing
        assert len(motion(0.0, 0.0, positions=pair.positions).partners(0)) == partners
    pair.positions[:, 1, 1] = 100.0
    for seen, partners in ((30, 1), (29, 0)):
        measured = np.arange(FRAMES)[:, None].repeat(2, axis=1) < seen
        few = motion(0.0, 0.0, positions=pair.positions, measured=measured)
        assert len(few.partners(0)) == partners


def test_steps_that_touch_some_frames() -> None:
    clip = motion(3.0)
    assert len(clip.steps(0, 40, 50, 1)) == 11  # from 39 to 40, ..., from 49 to 50
    assert len(clip.steps(0, 40, 50, 2)) == 12
    assert clip.steps(0, 40, 50, 1) == pytest.approx(3.0)
    assert clip.steps(0, 40, 50, 2) == pytest.approx(0.0)
    clip.positions[45] = np.nan
    assert len(clip.steps(0, 40, 50, 1)) == 9

"""Steps of paths, against sums over single frames."""

import math

import numpy as np
import pytest

from priorfill.geometry.step_lengths import MIN_STEPS, greatest_step, step_lengths


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("step", [1, 3])
def test_frame_by_frame(step: int, order: int) -> None:
    path = np.random.default_rng(1).normal(size=(20, 3))
    path[7] = np.nan
    found = step_lengths(path, step, order)
    assert len(found) == 20 - order * step
    for frame, length in enumerate(found):
        ends = [path[frame + number * step] for number in range(order + 1)]
        change = ends[1] - ends[0] if order == 1 else ends[2] - ends[1] - (ends[1] - ends[0])
        expected = math.dist(change, (0.0, 0.0, 0.0))
        assert length == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize("frames", range(7))
def test_short_paths_have_no_steps(frames: int) -> None:
    assert len(step_lengths(np.zeros((frames, 3)), 3, 2)) == 0


def test_two_wrong_steps_do_not_count() -> None:
    lengths = np.r_[np.arange(10.0), np.nan, 500.0, 400.0]
    assert greatest_step(lengths) == 9.0
    assert math.isnan(greatest_step(np.r_[np.ones(MIN_STEPS - 1), np.nan]))

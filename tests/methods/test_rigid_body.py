"""The rigid-body fill: exact on rigid bodies, no fill without one."""

import numpy as np
import pytest
from gappy import with_gaps
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from priorfill.clip import Clip
from priorfill.filling.fill_clip import fill

LABELS = tuple(f"M{i}" for i in range(6))


def tumbling(seed: int, frames: int = 60, labels: tuple[str, ...] = LABELS) -> Clip:
    """A moving and rotating rigid body of some markers."""
    rng = np.random.default_rng(seed)
    body = rng.uniform(-150.0, 150.0, (len(labels), 3))
    time = np.linspace(0.0, 1.0, frames)
    turned = Rotation.from_rotvec(np.outer(time, rng.uniform(-4.0, 4.0, 3))).as_matrix()
    moved = np.outer(time, rng.uniform(-900.0, 900.0, 3)) + 40.0 * np.sin(9.0 * time)[:, None]
    return Clip(body @ np.swapaxes(turned, 1, 2) + moved[:, None], labels, 100.0)


@given(st.integers(0, 2**31), st.integers(0, 5), st.integers(0, 30), st.integers(1, 30))
@example(309, 4, 20, 30)  # one of its markers stays near its lowest height for 0.09 s
@settings(max_examples=30, deadline=None, derandomize=True)
def test_a_rigid_body_is_filled_exactly(seed, marker, start, frames):
    whole = tumbling(seed)
    clip = with_gaps(whole, (start, start + frames, (LABELS[marker],)))
    result = fill(clip, method="rigid")
    # four neighbours may be nearly collinear
    assume(result.filled.any())
    assert result.complete
    np.testing.assert_allclose(result.clip.positions, whole.positions, atol=1e-6)


def test_the_local_position_is_interpolated_across_the_gap():
    """The fill of a marker that slips by 10 mm in the gap is continuous at both edges."""
    whole = tumbling(1)
    slipped = whole.positions.copy()
    # along the line from another marker, in the frame of the body
    outward = slipped[:, 0] - slipped[:, 1]
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    slip = np.interp(np.arange(60), [20, 40], [0.0, 10.0])
    slipped[:, 0] += slip[:, None] * outward
    clip = with_gaps(whole.with_positions(slipped), (20, 41, ("M0",)))
    found = fill(clip, method="rigid").clip.positions
    assert np.linalg.norm(found - slipped, axis=2).max() < 1.0


def test_markers_at_varying_distances_are_not_neighbours():
    whole = tumbling(2, labels=LABELS[:4])
    wild = np.random.default_rng(0).normal(0.0, 80.0, (60, 3, 3)) + whole.positions[:, :3]
    both = Clip(
        np.concatenate([whole.positions, wild], axis=1), (*LABELS[:4], "A", "B", "C"), 100.0
    )
    result = fill(with_gaps(both, (20, 40, ("M0", "A"))), method="rigid")
    filled = {gap.label: gap for gap in result.gaps}
    assert filled["M0"].complete
    np.testing.assert_allclose(result.clip.positions[:, 0], whole.positions[:, 0], atol=1e-6)
    assert filled["A"].filled == 0
    assert "three visible markers" in filled["A"].unfilled[0].reason


@pytest.mark.parametrize("kept", [2, 3])
def test_frames_with_too_few_neighbours_stay_missing(kept):
    whole = tumbling(3)
    clip = with_gaps(whole, (20, 40, ("M0",)), (25, 30, LABELS[1 : 6 - kept]))
    gap = fill(clip, method="rigid").gaps[0]
    assert gap.filled == (20 if kept == 3 else 15)


def test_collinear_neighbours_do_not_determine_the_rotation():
    line = np.zeros((60, 4, 3))
    line[:, :3, 0] = [0.0, 100.0, 200.0]
    line[:, 3] = [100.0, 80.0, 0.0]
    clip = with_gaps(Clip(line, LABELS[:4], 100.0), (20, 30, ("M3",)))
    assert fill(clip, method="rigid").gaps[0].filled == 0

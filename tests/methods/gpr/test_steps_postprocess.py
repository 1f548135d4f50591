"""Post-processing of predictions: floor and smoothing."""

from __future__ import annotations

import numpy as np
import pytest
from gappy import FOOT, person, with_gaps

from priorfill.constraints.floor import FloorOptions, enforce_floor
from priorfill.gaps import gap_groups
from priorfill.markers.describe import describe
from priorfill.methods.gpr.gap_segments import GapSegment
from priorfill.methods.gpr.postprocess import PostProcessor
from priorfill.methods.gpr.prediction import SegmentPrediction
from priorfill.methods.task import Task
from priorfill.signal.smoothing import SmoothingOptions, low_pass, smooth_jitter

RATE = 100.0


# --- both together ---


def test_a_prediction_is_raised_and_smoothed() -> None:
    """A foot that is predicted 15 mm too low, with noise of 3 mm."""
    truth = person(rate=RATE)
    markers = np.array([truth.labels.index(label) for label in FOOT])
    clip = with_gaps(truth, (150, 260, FOOT))
    groups = tuple(gap_groups(clip.missing))
    task = Task(clip.positions, clip.labels, clip.rate, describe(clip), groups)
    spread = np.full((len(truth.labels),) * 2, 50.0)
    spread[np.ix_(markers, markers)] = 1.0
    rng = np.random.default_rng(0)
    off = rng.normal(0.0, 3.0, (110, len(markers), 3)) - [0.0, 0.0, 15.0]
    visible = np.setdiff1d(np.arange(len(truth.labels)), markers)
    given = SegmentPrediction(
        GapSegment(markers, 150, 260, visible),
        150,
        truth.positions[150:260, markers] + off,
        np.full((110, len(markers)), 20.0),
        complete=True,
        source="",
    )
    task.geometry.__dict__["spread"] = spread
    process = PostProcessor(task, FloorOptions(), SmoothingOptions())
    found, raised = process(given), process.enforce_floor(given)

    def roughness(positions: np.ndarray) -> float:
        return float(np.sqrt((np.diff(positions, 2, axis=0) ** 2).sum(axis=2).mean()))

    def below(positions: np.ndarray) -> float:
        floor = np.percentile(np.delete(truth.positions, np.s_[150:260], 0)[:, markers, 2], 1, 0)
        return float((floor - positions[..., 2]).max())

    inside = truth.positions[150:260, markers]
    assert below(given.positions) > 18.0
    # the floor is that of the lower foot
    assert below(found.positions) < 12.0
    assert below(raised.positions) < 12.0
    # with noise of 3 mm more than 5 mm
    assert roughness(found.positions) < 2.0 * roughness(inside)
    assert roughness(raised.positions) > 4.0 * roughness(inside)


# --- floor ---


def test_a_lift_of_the_toe_does_not_push_the_heel_into_the_floor() -> None:
    """The toe is predicted 20 mm too low, the heel right on the floor."""
    foot = np.array([[0.0, 0.0, 30.0], [60.0, 0.0, 40.0], [200.0, 0.0, 10.0]])
    predicted = np.tile(foot, (40, 1, 1))
    visible = np.tile([[0.0, 0.0, 400.0]], (40, 1, 1))
    spread = np.full((3, 4), 50.0)
    spread[:, :3] = 1.0
    floor = np.array([30.0, -np.inf, 30.0])
    raised = enforce_floor(predicted, np.full((40, 3), 20.0), visible, spread, floor, RATE)
    assert (floor - raised[..., 2])[:, [0, 2]].max() < 1.0


# --- smoothing ---


@pytest.mark.parametrize(("deviations", "smoothed"), [(1.7, False), (3.0, True)])
def test_smoothing_moves_a_prediction_by_no_more_than_half_of_its_error(
    deviations: float, smoothed: bool
) -> None:
    """Expected errors as multiples of the rms distance to the mildest low-pass."""
    rng = np.random.default_rng(0)
    path = np.cumsum(rng.normal(0.0, 1.0, (200, 1, 3)), axis=0)
    moved = np.sqrt(((low_pass(path, RATE, 20.0) - path) ** 2).sum(axis=2).mean())
    found = smooth_jitter(path, np.full((200, 1), deviations * moved), np.zeros(1), RATE)
    assert (np.abs(found - path).max() > 0.1 * moved) == smoothed

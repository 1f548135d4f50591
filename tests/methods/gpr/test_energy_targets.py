"""Targets of the energy from predictions."""

import numpy as np

from priorfill.gaps import Gap, GapGroup
from priorfill.methods.gpr.energy_targets import MIN_ERROR, targets_from
from priorfill.methods.gpr.gap_segments import GapSegment
from priorfill.methods.gpr.options import JoiningOptions
from priorfill.methods.gpr.prediction import SegmentPrediction
from priorfill.signal.resample import Resolution


def test_an_expected_error_of_0_has_a_finite_weight():
    segment = GapSegment(np.array([0]), 2, 4, np.array([1, 2, 3]))
    predicted = np.ones((6, 1, 3))
    prediction = SegmentPrediction(segment, 0, predicted, np.zeros((6, 1)), True, "nothing moves")
    group = GapGroup(2, 4, (Gap(2, 4, 0),))
    level = Resolution(np.ones((6, 4, 3)), 100.0, 1)
    prior = targets_from([prediction], group, JoiningOptions())(level, np.arange(6))
    np.testing.assert_allclose(prior.pose_weight[2:4], MIN_ERROR**-2.0)
    assert np.isfinite(prior.acceleration_weight).all()

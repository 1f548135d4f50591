"""Coupling of missing markers to visible ones."""

import numpy as np

from priorfill.methods.gpr.dropout.marker_coupling import MarkerCoupling
from priorfill.methods.gpr.dropout.options import DropoutOptions


def test_markers_kilometres_away_have_no_shape():
    """All weights are 0 there."""
    far = MarkerCoupling(np.full(3, 1e9), np.zeros(3), np.zeros((3, 3)))
    visible = np.random.default_rng(0).normal(0.0, 1e9, (5, 3, 3))
    np.testing.assert_array_equal(far.body_shape(visible, DropoutOptions()), np.zeros(3))

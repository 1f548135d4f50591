"""Cubic splines, compared with SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from priorfill.signal.cubic_spline import cubic_spline


@pytest.mark.parametrize("count", [2, 3, 4, 5, 40])
@pytest.mark.parametrize("natural", [False, True])
def test_the_spline_is_that_of_scipy(count: int, natural: bool) -> None:
    rng = np.random.default_rng(count)
    knots = np.cumsum(rng.uniform(0.1, 2.0, count))
    values = rng.normal(size=(count, 2, 3))
    query = np.linspace(knots[0] - 0.5, knots[-1] + 0.5, 70)
    expected = CubicSpline(knots, values, bc_type="natural" if natural else "not-a-knot")(query)
    found = cubic_spline(knots, values, query, natural=natural)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)

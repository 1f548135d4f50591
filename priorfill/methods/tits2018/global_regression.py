"""Global linear regression (``glr``) of a marker on the markers visible throughout its gap.

Each coordinate is regressed, by least squares, on a constant and on all coordinates of those
markers whose distance from the missing one varies little.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap
from priorfill.methods.tits2018.continuity import ramp
from priorfill.methods.tits2018.scaling import Scale
from priorfill.methods.tits2018.tits2018_options import Tits2018Options, thinned

__all__ = ["MIN_PREDICTORS", "predict"]

Array = NDArray[np.float64]

MIN_PREDICTORS = 4
"""Markers that must be visible throughout a gap."""


def predict(
    positions: Array, marker: int, gaps: list[Gap], deviations: Array, options: Tits2018Options
) -> Array:
    """Predict a marker in its gaps.

    Gaps in which the same markers are visible share a regression.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    marker : int
        The missing marker.
    gaps : list of Gap
        Its gaps.
    deviations : ndarray [shape=(markers,), mm]
        Standard deviation of its distance from each marker.
    options : Tits2018Options
        Which markers and how many training rows are used.

    Returns
    -------
    ndarray [shape=(frames, 3), mm]
        NaN outside the gaps, and where too few markers are visible.
    """
    frames = len(positions)
    out = np.full((frames, 3), np.nan)
    seen = ~np.isnan(positions[..., 0])
    by_visible: dict[bytes, list[Gap]] = {}
    for gap in gaps:
        throughout = seen[max(gap.start - 1, 0) : gap.stop + 1].all(axis=0)
        by_visible.setdefault(throughout.tobytes(), []).append(gap)
    for key, some in by_visible.items():
        among = np.flatnonzero(np.frombuffer(key, dtype=bool))
        if len(among) < MIN_PREDICTORS:
            continue
        constant = among[~(deviations[among] > options.max_distance_sd)]
        used = constant if len(constant) else among
        rows = np.flatnonzero(seen[:, marker] & seen[:, used].all(axis=1))
        if not len(rows):
            continue
        rows = rows[thinned(len(rows), options.global_rows)]
        target = Scale.of(positions[rows, marker])
        coefficients = np.linalg.lstsq(
            _design(positions[np.ix_(rows, used)]),
            target.down(positions[rows, marker]),
            rcond=None,
        )[0]
        for gap in some:
            first, last = max(gap.start - 1, 0), min(gap.stop, frames - 1)
            at = np.arange(first, last + 1)
            curve = target.up(_design(positions[np.ix_(at, used)]) @ coefficients)
            before = curve[0] - positions[first, marker] if gap.start > 0 else None
            after = curve[-1] - positions[last, marker] if gap.stop < frames else None
            curve -= ramp(len(curve), before, after)
            out[gap.start : gap.stop] = curve[gap.start - first :][: gap.frames]
    return out


def _design(positions: Array) -> Array:
    """Return the design matrix: a row per frame, with a constant and all coordinates."""
    rows = positions.reshape(len(positions), -1)
    return np.column_stack([np.ones(len(rows)), rows])

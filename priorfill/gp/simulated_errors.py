"""Errors of the models in simulated gaps, combined with those of the clip's own held-out blocks.

The blocks of a clip tell how well a model predicts the movement that the clip shows elsewhere;
simulated gaps (`priorfill.gp.problem.SimulatedGap`), how well it predicts movement like that in the
gap, on other takes. Logarithms of both errors are averaged: the more simulated gaps there are, the
more they count. They also tell how much better a problem is than the clip's own poses alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.problem import SimulatedGap
from priorfill.runtime.elementary import exp, log
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = [
    "SimulatedErrorOptions",
    "combined_errors",
    "gap_errors",
    "likeness_of",
    "log_ratio_to_own",
]

MIN_ERROR = 1e-6
"""mm. Least error whose logarithm is taken: that of a recording without movement is 0."""


MAX_RATIO = 4.0
"""Of the errors of two problems in a simulated gap, either way: a repetition of the movement in the
same take's session makes the database perfect there."""

MIN_LIKENESS = 1e-9
"""Where no simulated gap is like the gap, all count alike; their share is 0."""


@dataclass(frozen=True)
class SimulatedErrorOptions:
    """What simulated gaps count.

    Simulated gaps are counted by their likeness.

    Attributes
    ----------
    max_share : float
        Share of simulated gaps in the mean of the logarithms of errors, the rest being that of the
        clip's held-out blocks, if there are very many.
    model_gaps : float
        With this many simulated gaps they have half of that share in the errors of models.
    problem_gaps : float
        The same for the ratio of two problems' errors: in a single simulated gap it is off by a
        factor of 1.8.
    calibration_gaps : float
        With this many simulated gaps they count as much as the clip's own blocks in the calibration
        of expected errors.
    own_bias : float
        Added to the logarithm of the ratio of a problem's errors to those of own poses in simulated
        gaps: a take's own poses are predicted with fewer models than the clip's, and its
        neighbours in the database may be nearer than the clip's.
    problem_trust : float
        Factor of the logarithm of the ratio of two problems' errors: on recordings of real people
        it says little, and equal shares are better than a choice. From 0.3 to 1 results differ by
        2 %.
    """

    max_share: float = 0.8
    model_gaps: float = 2.0
    problem_gaps: float = 4.0
    calibration_gaps: float = 2.0
    own_bias: float = 0.25
    problem_trust: float = 0.7

    def __post_init__(self) -> None:
        check_between(self, 0.0, 1.0, "max_share", "problem_trust")
        check_at_least(self, 0.0, "model_gaps", "problem_gaps", "calibration_gaps")
        check_between(self, 0.0, 1.0, "own_bias")

    def model_share(self, gaps: Sequence[SimulatedGap]) -> float:
        """Return the share of simulated gaps in the errors of a problem's models."""
        return self.max_share * _saturating(_like(gaps), self.model_gaps)

    def level_share(self, gaps: Sequence[SimulatedGap]) -> float:
        """Return the share of simulated gaps in the errors of whole problems."""
        return self.max_share * _saturating(_like(gaps), self.problem_gaps)

    def calibration_share(self, gaps: Sequence[SimulatedGap]) -> float:
        """Return the share of simulated gaps in the calibration of expected errors."""
        return _saturating(_like(gaps), self.calibration_gaps)


def likeness_of(gaps: Sequence[SimulatedGap]) -> NDArray[np.float64]:
    """Return the likeness of each simulated gap [shape=(gaps,)]."""
    return np.array([gap.likeness for gap in gaps])


def _like(gaps: Sequence[SimulatedGap]) -> float:
    """Return the number of simulated gaps, each counted by its likeness."""
    return float(likeness_of(gaps).sum())


def _saturating(count: float, half: float) -> float:
    """Return a share that grows with a count from 0 to 1, and is a half where it is ``half``."""
    return count / (count + half) if count else 0.0


def gap_errors(residuals: NDArray[np.float64], gaps: Sequence[SimulatedGap]) -> NDArray[np.float64]:
    """Return the rms error (Euclidean) in each simulated gap [shape=(..., gaps)].

    Parameters
    ----------
    residuals : ndarray [shape=(..., poses, targets, 3), mm]
        Of the poses of all gaps, one gap after the other.
    gaps : sequence of SimulatedGap
        The gaps.
    """
    square = (residuals**2).sum(axis=-1).mean(axis=-1)
    stops = np.cumsum([len(gap.rows) for gap in gaps])
    parts = np.split(square, stops[:-1], axis=-1)
    errors: NDArray[np.float64] = np.sqrt(np.stack([p.mean(axis=-1) for p in parts], axis=-1))
    return errors


def _log_mean(errors: NDArray[np.float64], likeness: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean of the logarithms of errors [shape=(..., gaps)] over the gaps."""
    weight = np.maximum(likeness, MIN_LIKENESS)
    mean: NDArray[np.float64] = log(np.maximum(errors, MIN_ERROR)) @ (weight / weight.sum())
    return mean


def combined_errors(
    held_out: NDArray[np.float64],
    simulated: NDArray[np.float64],
    likeness: NDArray[np.float64],
    share: float,
) -> NDArray[np.float64]:
    """Return the geometric mean of the errors of models in held-out blocks and simulated gaps.

    Parameters
    ----------
    held_out : ndarray [shape=(models,)]
        In the clip's blocks.
    simulated : ndarray [shape=(models, gaps)]
        In each simulated gap.
    likeness : ndarray [shape=(gaps,)]
        Of the gaps, by which their logarithms are weighted.
    share : float
        Of the simulated gaps.

    Examples
    --------
    >>> import numpy as np
    >>> combined_errors(np.array([9.0, 4.0]), np.array([[4.0], [4.0]]), np.ones(1), 0.5).round(6)
    array([6., 4.])
    """
    mixed: NDArray[np.float64] = exp(
        (1.0 - share) * log(np.maximum(held_out, MIN_ERROR))
        + share * _log_mean(simulated, likeness)
    )
    return mixed


def log_ratio_to_own(
    residuals: NDArray[np.float64], weight: NDArray[np.float64], gaps: Sequence[SimulatedGap]
) -> float:
    """Return the logarithm of how much larger a problem's errors are than those of own poses.

    Parameters
    ----------
    residuals : ndarray [shape=(models, poses, targets, 3), mm]
        Of the problem's models in the simulated gaps.
    weight : ndarray [shape=(models,)]
        Of the models; sum 1.
    gaps : sequence of SimulatedGap
        The gaps, with the errors of each recording's own poses.

    Returns
    -------
    float
        The mean over the gaps, by likeness; below 0 where the problem is better.
    """
    mean = np.einsum("k,krmi->rmi", weight, residuals)
    own = np.concatenate([gap.own_residuals for gap in gaps])
    errors, own_errors = (np.maximum(gap_errors(r, gaps), MIN_ERROR) for r in (mean, own))
    ratio = np.clip(errors / own_errors, 1.0 / MAX_RATIO, MAX_RATIO)
    return float(_log_mean(ratio, likeness_of(gaps)))

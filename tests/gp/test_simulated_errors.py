"""Simulated gaps weight problems and models, and calibrate expected errors."""

from dataclasses import replace

import numpy as np
import pytest

from priorfill.gp.ensemble import EnsembleOptions, Regression, regress
from priorfill.gp.features import Alignment
from priorfill.gp.kernels import Constant, Exponential
from priorfill.gp.pose_process import PoseProcess
from priorfill.gp.problem import GPModel, PoseSamples, RegressionProblem, SimulatedGap
from priorfill.gp.simulated_errors import (
    MAX_RATIO,
    SimulatedErrorOptions,
    combined_errors,
    gap_errors,
    log_ratio_to_own,
)

PROCESS = PoseProcess(
    linear=1.0,
    rbf=0.1,
    of_time=0.001 * Exponential(0.1),
    noise_variance=1e-4,
    factor=Constant(),
)
MODELS = [GPModel(Alignment("rigid", 220.0, 0.005, 10.0), None, PROCESS)]
SURE = {
    "problem_trust": 1.0,
    "max_share": 1.0,
    "model_gaps": 0.0,
    "problem_gaps": 0.0,
    "calibration_gaps": 0.0,
}
"""Simulated gaps count alone."""

SIMULATED = np.arange(20, 40)
"""Rows of the second recording that are held out."""


def problems(own_error: float, likeness: float = 1.0) -> list[RegressionProblem]:
    """The clip's own problem, and one with another recording whose missing marker is elsewhere.

    In a gap simulated there, its own poses err by ``own_error`` mm.
    """
    rng = np.random.default_rng(5)
    shape = rng.normal(0.0, 100.0, (5, 3))
    poses = np.tile(shape, (160, 1, 1)) + rng.normal(0.0, 1.0, (160, 5, 3))
    poses[:, 1:3, 2] += 60.0 * np.sin(np.arange(160) / 20.0)[:, None]
    time, gap, seen = np.arange(160) / 100.0, np.arange(40, 80), np.r_[0:40, 80:160]
    other = poses + np.array([0.0, 0.0, 10.0]) * (np.arange(5) == 0)[:, None]
    own = RegressionProblem(
        PoseSamples(poses[seen, 1:], poses[seen, :1], time[seen], np.zeros(120, dtype=np.intp)),
        PoseSamples(poses[gap, 1:], np.empty((40, 0, 3)), time[gap], np.zeros(40, dtype=np.intp)),
        np.linalg.norm(shape[1:] - shape[0], axis=1),
        np.full(4, 2.0),
    )
    both = PoseSamples(
        np.concatenate([own.train.visible, other[:, 1:]]),
        np.concatenate([own.train.missing, other[:, :1]]),
        np.concatenate([own.train.time, time]),
        np.repeat([0, 1], [120, 160]),
        np.repeat([1.0, 0.9], [120, 160]),
    )
    residuals = np.zeros((len(SIMULATED), 1, 3))
    residuals[..., 0] = own_error
    simulated = SimulatedGap(
        120 + SIMULATED, residuals, np.full((len(SIMULATED), 1), own_error), likeness
    )
    return [own, replace(own, train=both, simulated_gaps=(simulated,))]


def found(own_error: float, likeness: float = 1.0, **simulated: float) -> Regression:
    options = EnsembleOptions(simulated=SimulatedErrorOptions(**simulated))
    return regress(problems(own_error, likeness), MODELS, 0.4, options=options)


def alone() -> list[np.ndarray]:
    """The predictions of both problems, each alone."""
    return [
        regress([replace(one, simulated_gaps=())], MODELS, 0.4).positions for one in problems(1.0)
    ]


def test_the_problem_that_is_better_in_simulated_gaps_has_the_weight() -> None:
    own, with_other = alone()
    assert np.abs(own - with_other).max() > 1.0
    better, worse = (found(own_error, **SURE).positions for own_error in (1e4, 1e-4))
    assert np.abs(better - with_other).max() < 0.7 * np.abs(worse - with_other).max()
    assert np.abs(worse - own).max() < 0.7 * np.abs(better - own).max()


def test_simulated_gaps_of_unlike_bodies_do_not_count() -> None:
    plain = regress([replace(one, simulated_gaps=()) for one in problems(1.0)], MODELS, 0.4)
    unlike = found(1e4, likeness=0.0)
    sure = found(1e4, **SURE)
    difference = np.abs(unlike.positions - plain.positions).max()
    assert difference < 0.25 * np.abs(sure.positions - plain.positions).max()
    assert unlike.bound_factor == pytest.approx(plain.bound_factor, rel=0.01)


def test_expected_errors_follow_the_simulated_gaps() -> None:
    """The larger the errors there, in units of those predicted, the larger those expected."""
    own = problems(1e-2)
    gap = own[1].simulated_gaps[0]
    rosy = replace(gap, own_rms=gap.own_rms / 50.0)
    options = EnsembleOptions(simulated=SimulatedErrorOptions(**SURE))
    expected = [
        regress([own[0], replace(own[1], simulated_gaps=(one,))], MODELS, 0.4, options=options)
        for one in (gap, rosy)
    ]
    assert expected[1].expected_rms.mean() > 5.0 * expected[0].expected_rms.mean()


def test_the_relative_error_says_what_the_second_problem_is_worth() -> None:
    assert found(1e4).relative_error < 0.8 < found(1e-4).relative_error
    assert np.isnan(regress(problems(1.0)[:1], MODELS, 0.4).relative_error)


def test_errors_of_gaps_are_those_of_their_poses() -> None:
    rng = np.random.default_rng(1)
    residuals = rng.normal(size=(3, 9, 2, 3))
    gaps = [SimulatedGap(np.arange(n), np.ones((n, 2, 3)), np.ones((n, 2))) for n in (4, 5)]
    expected = [
        [np.sqrt((model[part] ** 2).sum(-1).mean()) for part in (slice(0, 4), slice(4, 9))]
        for model in residuals
    ]
    np.testing.assert_allclose(gap_errors(residuals, gaps), expected)
    weight = np.array([0.2, 0.3, 0.5])
    mean = sum(w * r for w, r in zip(weight, residuals, strict=True))
    ratio = np.log(gap_errors(mean, gaps) / np.sqrt(3.0)).mean()
    assert log_ratio_to_own(residuals, weight, gaps) == pytest.approx(ratio)
    # one gap that is predicted perfectly does not decide
    residuals[:, :4] = 0.0
    capped = np.log([1.0 / MAX_RATIO, gap_errors(mean, gaps)[1] / np.sqrt(3.0)]).mean()
    assert log_ratio_to_own(residuals, weight, gaps) == pytest.approx(capped)


def test_no_simulated_gap_leaves_the_held_out_errors() -> None:
    held_out = np.array([1.0, 2.0])
    np.testing.assert_allclose(
        combined_errors(held_out, np.ones((2, 3)), np.ones(3), 0.0), held_out
    )
    assert SimulatedErrorOptions().model_share(()) == 0.0

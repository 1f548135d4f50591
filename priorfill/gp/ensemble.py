"""Gaussian-process regression from visible to missing markers by an ensemble of models.

The training poses are those in which the missing markers were measured. Poses are aligned near
the gap (`priorfill.gp.features.Alignment`), the coordinates of the visible markers are weighted by
their distance from the missing ones and by how rigidly they are linked with them, and a Gaussian
process predicts the missing coordinates in the aligned frame. Its kernel has a linear part (a body
segment's markers are nearly a linear function of each other over similar poses), a squared
exponential part (similar poses, as in nearest-neighbour regression), and a part that decays with
the time between poses, which joins the prediction to the measured samples at the gap's edges.

Similar poses may belong to different movements. Lag features (`priorfill.gp.features.LagFeature`)
add the positions of the visible markers shortly before and after, or their displacement.

No alignment, lag feature and kernel is best for all movements. Each combination is a *model* of
the ensemble. All models are fitted, and are weighted by their cross-validated error, with blocks of
the gap's length held out [RW06]_ (section 5.3): `priorfill.gp.process.FittedGP.leave_blocks_out`.
A model whose predictive standard deviation in the gap exceeds that of the held-out blocks has less
weight there. The ensemble's own errors on the held-out blocks calibrate its expected errors.

Velocities of the missing markers, where the training poses have them, are further targets with
the same covariance, and are combined by weights of their own. `priorfill.constraints` fuses them
with the positions.

References
----------
.. [RW06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.calibration import calibrate
from priorfill.gp.fitted_models import FittedModel, FittedModels, Predictions, SharedCovariances
from priorfill.gp.linalg import power_weights
from priorfill.gp.problem import GPModel, RegressionProblem
from priorfill.gp.simulated_errors import (
    SimulatedErrorOptions,
    combined_errors,
    gap_errors,
    likeness_of,
    log_ratio_to_own,
)
from priorfill.gp.velocities import VelocityErrorOptions, VelocityPrediction, error_by_speed
from priorfill.runtime.elementary import exp, log, power
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = ["EnsembleOptions", "Regression", "regress"]

BATCH_SIZE = 200
"""Queries predicted at a time: a model's matrices take 0.4 MB each, and the predictions of a
hundred models for a dozen targets 8 MB, however long the gap is."""

MIN_MODEL_ERROR = 1e-6
"""mm. Least cross-validated error of a model: that of a clip without movement is 0."""

MIN_VARIANCE = 1e-12
"""mm². Least predicted variance of a held-out pose."""


@dataclass(frozen=True)
class EnsembleOptions:
    """How the models of an ensemble are weighted, and how its errors are calibrated.

    Attributes
    ----------
    weight_power : float
        Models are weighted by their cross-validated error to the power of minus this: 0 is the
        mean of all, infinity the best one alone, and both fill worse.
    relative_std_power : float
        In each frame the error of a model is multiplied by its relative standard deviation to
        this power. From 0.25 to 0.5 results are alike; 0 and 1 are worse by one or two per cent,
        and far worse in the worst case.
    prior_blocks : float
        The calibration without data (expected errors as predicted, and
        `priorfill.gp.calibration.BOUND_FACTOR`) counts as this many held-out blocks: few blocks
        tell little about the tails of the errors.
    selection_inflation : float
        Factor on the expected error of models of all problems but the first. Their weights are
        set by the same blocks that calibrate them: in 60 gaps, without this factor, the 90 % bound
        held for 85 % of the samples with a database, and for 90 % without one.
    min_expected_rms : float
        mm. Least expected error; a marker at the place of a visible one could have none.
    min_common_poses : int
        Held-out poses that all problems must have in common to calibrate their ensemble;
        otherwise the problem with the greatest weight is calibrated alone.
    velocity_errors : VelocityErrorOptions
        Of the expected errors of velocities.
    simulated : SimulatedErrorOptions
        What gaps simulated in other recordings count.
    """

    weight_power: float = 8.0
    relative_std_power: float = 0.35
    prior_blocks: float = 8.0
    selection_inflation: float = 1.3
    min_expected_rms: float = 1e-3
    min_common_poses: int = 20
    velocity_errors: VelocityErrorOptions = field(default_factory=VelocityErrorOptions)
    simulated: SimulatedErrorOptions = field(default_factory=SimulatedErrorOptions)

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "weight_power", "prior_blocks")
        check_between(self, 0.0, 10.0, "relative_std_power")  # beyond, errors overflow
        check_at_least(self, 0.1, "selection_inflation")
        check_at_least(self, 1e-9, "min_expected_rms")
        check_at_least(self, 1, "min_common_poses")


@dataclass(frozen=True, eq=False)
class Regression:
    """The ensemble's prediction of the missing markers.

    Attributes
    ----------
    positions : ndarray [shape=(poses, missing markers, 3), mm]
        Upright.
    expected_rms : ndarray [shape=(poses, missing markers), mm]
        Expected rms error (Euclidean).
    bound_factor : float
        Factor of `expected_rms` that gives the bound below which 90 % of the errors are expected.
    velocity : VelocityPrediction or None
        Velocities of the missing markers, if the training poses of all problems have them.
    relative_error : float
        Ratio of the error to that of the first problem alone, as the held-out blocks and the
        simulated gaps show it; NaN without simulated gaps.
    """

    positions: NDArray[np.float64]
    expected_rms: NDArray[np.float64]
    bound_factor: float
    velocity: VelocityPrediction | None = None
    relative_error: float = float("nan")

    def subset(self, chosen: slice) -> Regression:
        """Return the prediction of some of the poses."""
        velocity = None if self.velocity is None else self.velocity.subset(chosen)
        return replace(
            self,
            positions=self.positions[chosen],
            expected_rms=self.expected_rms[chosen],
            velocity=velocity,
        )


def regress(
    problems: Sequence[RegressionProblem],
    models: Sequence[GPModel],
    block_seconds: float,
    inside: NDArray[np.bool_] | None = None,
    map_function: Callable[..., Iterable[Any]] = map,
    options: EnsembleOptions = EnsembleOptions(),
) -> Regression:
    """Predict the missing markers of some poses.

    Parameters
    ----------
    problems : sequence of RegressionProblem
        Training sets for the same missing markers and the same queries.
    models : sequence of GPModel
        Each is fitted to each problem that has its lag feature and no models of its own. Those of
        one alignment must follow each other.
    block_seconds : float
        s. Length of the held-out blocks: that of the gap.
    inside : ndarray of bool [shape=(poses,)], optional
        Queries over which a model's weight is averaged, for the calibration; all by default.
    map_function : callable
        `map`, or a function like it that works on several items at a time, such as that of
        `priorfill.runtime.threads.map_in_threads`.
    options : EnsembleOptions
        Weights and calibration.

    Returns
    -------
    Regression
        The weighted mean of the models.

    See Also
    --------
    priorfill.gp.process.GaussianProcess : a single process.
    """
    queries = len(problems[0].query.time)
    if inside is None:
        inside = np.ones(queries, dtype=bool)
    fitted = _fit(problems, models, block_seconds, map_function)
    markers = problems[0].train.missing.shape[1]
    worth = _log_ratios(fitted, slice(0, markers), options)
    ensembles = [_Ensemble.of(fitted, slice(0, markers), worth, queries, options)]
    if all(problem.train.velocity is not None for problem in problems):
        ensembles.append(_Ensemble.of(fitted, slice(markers, None), worth, queries, options))
    batches = [slice(start, start + BATCH_SIZE) for start in range(0, queries, BATCH_SIZE)]

    def combined(batch: slice) -> list[_Combined]:
        predictions = _predict(fitted, batch, map_function)
        return [ensemble.combined(predictions, inside[batch]) for ensemble in ensembles]

    for batch, found in zip(batches, map_function(combined, batches), strict=True):
        for ensemble, part in zip(ensembles, found, strict=True):
            ensemble.add(batch, part)
    position, validation = ensembles[0], ensembles[0].cross_validate()
    factor, bound = _calibrate(validation, options)
    factor *= float(power(options.selection_inflation, validation.further_weight))
    factor, bound = _calibrate_by_simulation(position, factor, bound, options)
    velocity = None
    if len(ensembles) > 1:
        velocity = _predicted_velocity(ensembles[1], validation, options)
    return Regression(
        position.mean,
        np.maximum(position.predicted_rms * factor, options.min_expected_rms),
        bound,
        velocity,
        _relative_error(position, options),
    )


@dataclass(frozen=True, eq=False)
class _FittedEnsemble:
    """Problems and the models fitted to them; the models of all problems in one order."""

    problems: Sequence[RegressionProblem]
    shared: Sequence[SharedCovariances]
    by_alignment: Sequence[FittedModels]
    problem_of: NDArray[np.intp]  # (models,)

    @property
    def models_of_problem(self) -> NDArray[np.intp]:
        """Number of models that are fitted to the problem of each model [shape=(models,)]."""
        counts: NDArray[np.intp] = np.bincount(self.problem_of)[self.problem_of]
        return counts

    @property
    def models(self) -> list[FittedModel]:
        """The fitted models of all problems and alignments."""
        return [model for models in self.by_alignment for model in models.fitted]


def _fit(
    problems: Sequence[RegressionProblem],
    models: Sequence[GPModel],
    block_seconds: float,
    map_function: Callable[..., Iterable[FittedModels]],
) -> _FittedEnsemble:
    """Fit the models; parameters as of `regress`."""
    supported = [
        [m for m in (models if p.models is None else p.models) if p.supports(m)] for p in problems
    ]
    shared = [
        SharedCovariances.of(problem, some, block_seconds)
        for problem, some in zip(problems, supported, strict=True)
    ]
    tasks = [
        (alignment, problem, tuple(group), common)
        for problem, common, some in zip(problems, shared, supported, strict=True)
        for alignment, group in groupby(some, key=lambda model: model.alignment)
    ]
    fitted = list(map_function(FittedModels.fit, *zip(*tasks, strict=True)))
    counts = [len(some) for some in supported]
    return _FittedEnsemble(problems, shared, fitted, np.repeat(np.arange(len(problems)), counts))


def _predict(
    fitted: _FittedEnsemble, batch: slice, map_function: Callable[..., Iterable[Predictions]]
) -> list[Predictions]:
    """Predict some of the queries with the models of each alignment."""
    inputs = {}
    for problem, shared in zip(fitted.problems, fitted.shared, strict=True):
        query = problem.query_batch(batch)
        inputs[id(shared)] = (query, shared.with_query(query))
    return list(
        map_function(lambda models: models.predict(*inputs[id(models.shared)]), fitted.by_alignment)
    )


def _held_out_errors(models: Sequence[FittedModel], targets: slice) -> NDArray[np.float64]:
    """Return the cross-validated rms errors of models [shape=(models,)]."""
    return np.sqrt([(m.residuals[:, targets] ** 2).sum(axis=2).mean() for m in models])


def _model_errors(
    fitted: _FittedEnsemble,
    targets: slice,
    worth: Mapping[int, float],
    options: EnsembleOptions,
) -> NDArray[np.float64]:
    """Return the errors by which the models are weighted [shape=(models,)].

    Parameters
    ----------
    fitted : _FittedEnsemble
        The models.
    targets : slice
        Which targets: positions or velocities.
    worth : mapping of int to float
        Of problems with simulated gaps: logarithm of the ratio of their errors to those of the
        clip's own problem, the first one.
    options : EnsembleOptions
        Weights.
    """
    models = fitted.models
    held_out = _held_out_errors(models, targets)
    error = held_out.copy()

    own_level = _level(held_out[fitted.problem_of == 0], options)
    simulation = options.simulated
    for number, problem in enumerate(fitted.problems[1:], start=1):
        some = np.flatnonzero(fitted.problem_of == number)
        difference = _level(held_out[some], options) - own_level
        gaps = problem.simulated_gaps
        if gaps:
            simulated = np.stack([models[k].simulated_residuals[:, targets] for k in some])
            share = simulation.model_share(gaps)
            error[some] = combined_errors(
                held_out[some], gap_errors(simulated, gaps), likeness_of(gaps), share
            )
            share = simulation.level_share(gaps)
            simulated_ratio = worth[number] + simulation.own_bias
            difference = (1.0 - share) * difference + share * simulated_ratio
        # the power of the weights is larger with simulated gaps, which are about models
        difference *= simulation.problem_trust / (1.0 + _simulated_share(fitted, options))
        error[some] *= float(exp(own_level + difference - _level(error[some], options)))
    return error


def _simulated_share(fitted: _FittedEnsemble, options: EnsembleOptions) -> float:
    """Return the largest share of simulated gaps in the errors of a problem's models.

    Errors that are means of two kinds differ less from model to model, and are more certain.
    """
    return max(options.simulated.model_share(p.simulated_gaps) for p in fitted.problems)


def _level(error: NDArray[np.float64], options: EnsembleOptions) -> float:
    """Return the logarithm of the weighted mean of models' errors."""
    some = np.maximum(error, MIN_MODEL_ERROR)
    return float(log(power_weights(some, options.weight_power) @ some))


def _log_ratios(
    fitted: _FittedEnsemble, targets: slice, options: EnsembleOptions
) -> dict[int, float]:
    """Return how much larger a problem's errors are than those of the clip's own problem.

    Returns
    -------
    dict of int to float
        The logarithm of the ratio in the simulated gaps, of each problem with such gaps.
    """
    ratios = {}
    for number, problem in enumerate(fitted.problems):
        gaps = problem.simulated_gaps
        if not gaps:
            continue
        models = [fitted.models[k] for k in np.flatnonzero(fitted.problem_of == number)]
        residuals = np.stack([model.simulated_residuals[:, targets] for model in models])
        error = combined_errors(
            _held_out_errors(models, targets),
            gap_errors(residuals, gaps),
            likeness_of(gaps),
            options.simulated.model_share(gaps),
        )
        weight = power_weights(np.maximum(error, MIN_MODEL_ERROR), options.weight_power)
        ratios[number] = log_ratio_to_own(residuals, weight, gaps)
    return ratios


class _Combined(NamedTuple):
    """The weighted mean of the models for some of the queries, a fraction of their predictions."""

    mean: NDArray[np.float64]  # (queries, targets, 3)
    predicted_rms: NDArray[np.float64]  # (queries, targets), not calibrated
    weight: NDArray[np.float64]  # (models,), summed over the queries in the gap


@dataclass(eq=False)
class _Ensemble:
    """The weighted mean of the models for some of the targets, one batch of queries at a time.

    The weights differ from query to query: see `EnsembleOptions`.
    """

    fitted: _FittedEnsemble
    targets: slice
    options: EnsembleOptions
    mean: NDArray[np.float64]  # (queries, targets, 3)
    predicted_rms: NDArray[np.float64]  # (queries, targets), not calibrated
    total_weight: NDArray[np.float64]  # (models,), summed over the queries in the gap
    error: NDArray[np.float64]  # (models,), rms; of the blocks and the simulated gaps
    power: float  # of the weights

    @classmethod
    def of(
        cls,
        fitted: _FittedEnsemble,
        targets: slice,
        worth: Mapping[int, float],
        queries: int,
        options: EnsembleOptions,
    ) -> _Ensemble:
        """Return an ensemble without predictions."""
        markers = fitted.problems[0].train.missing.shape[1]
        return cls(
            fitted,
            targets,
            options,
            np.empty((queries, markers, 3)),
            np.empty((queries, markers)),
            np.zeros(len(fitted.models)),
            _model_errors(fitted, targets, worth, options),
            options.weight_power * (1.0 + _simulated_share(fitted, options)),
        )

    def combined(self, predictions: Sequence[Predictions], inside: NDArray[np.bool_]) -> _Combined:
        """Combine the predictions of some of the queries.

        Parameters
        ----------
        predictions : sequence of Predictions
            Of the models of each alignment.
        inside : ndarray of bool [shape=(queries,)]
            Which of the queries are in the gap.
        """
        each = np.concatenate([one.mean[:, :, self.targets] for one in predictions])
        variance = np.concatenate([one.variance[:, :, self.targets] for one in predictions])
        relative_std = np.concatenate([one.relative_std for one in predictions])
        penalty = np.array([problem.error_penalty for problem in self.fitted.problems])
        relative = power(relative_std, self.options.relative_std_power)
        error = np.maximum(self.error[:, None] * relative, MIN_MODEL_ERROR)
        error = error * penalty[self.fitted.problem_of, None]
        weight = power_weights(error, self.power)
        if len(penalty) > 1:
            weight /= self.fitted.models_of_problem[:, None]
            weight /= weight.sum(axis=0)
        mean = np.einsum("kq,kqmi->qmi", weight, each)
        each -= mean
        # spelt out, because a sum over an axis of length three is slow
        disagreement = each[..., 0] ** 2 + each[..., 1] ** 2 + each[..., 2] ** 2
        return _Combined(
            mean,
            np.sqrt(np.einsum("kq,kqm->qm", weight, variance + disagreement)),
            weight[:, inside].sum(axis=1),
        )

    def add(self, batch: slice, combined: _Combined) -> None:
        """Add a batch of queries; batch after batch, for sums in the same order."""
        self.mean[batch], self.predicted_rms[batch] = combined.mean, combined.predicted_rms
        self.total_weight += combined.weight

    def cross_validate(self) -> _CrossValidation:
        """Return the errors on the held-out poses.

        These are the poses that all problems share, or else those of the problem with the greatest
        weight.
        """
        fitted, models = self.fitted, self.fitted.models
        weight = self.total_weight / self.total_weight.sum()
        problems, shared, problem_of = fitted.problems, fitted.shared, fitted.problem_of
        times = [p.train.time[s.held_out] for p, s in zip(problems, shared, strict=True)]
        common = reduce(np.intersect1d, times)
        if len(problems) > 1 and len(common) >= self.options.min_common_poses:
            used, main = np.arange(len(models)), 0
            rows = [np.searchsorted(time, common) for time in times]
        else:
            main = int(np.argmax(np.bincount(problem_of, weight)))
            used = np.flatnonzero(problem_of == main)
            rows = [np.arange(len(time)) for time in times]
        velocity = problems[main].train.velocity
        measured = np.empty((len(rows[main]), 0, 3))
        if velocity is not None and self.targets.start:
            measured = velocity[shared[main].held_out[rows[main]]]
        return _CrossValidation(
            weight[used] / weight[used].sum(),
            np.stack([models[k].residuals[rows[problem_of[k]], self.targets] for k in used]),
            np.stack(
                [models[k].held_out_variance[rows[problem_of[k]], self.targets] for k in used]
            ),
            measured,
            min(len(s.blocks) for s in shared),
            float(weight[problem_of > 0].sum()),
        )


@dataclass(frozen=True, eq=False)
class _CrossValidation:
    """Errors of an ensemble on held-out poses, with its mean weights in the gap."""

    weight: NDArray[np.float64]  # (models,), sum 1
    residuals: NDArray[np.float64]  # (models, poses, targets, 3)
    held_out_variance: NDArray[np.float64]  # (models, poses, targets)
    velocity: NDArray[np.float64]  # (poses, targets, 3), measured; no targets for positions
    blocks: int  # number of held-out blocks
    further_weight: float = 0.0  # of the models of all problems but the first

    @property
    def ensemble_residuals(self) -> NDArray[np.float64]:
        """Residuals of the weighted mean [shape=(poses, targets, 3)]."""
        residuals: NDArray[np.float64] = np.einsum("k,krmi->rmi", self.weight, self.residuals)
        return residuals


def _calibrate(validation: _CrossValidation, options: EnsembleOptions) -> tuple[float, float]:
    """Calibrate the predicted errors of an ensemble by its errors on held-out poses.

    Returns
    -------
    factor : float
        By which the predicted rms error is to be multiplied.
    bound : float
        Ratio of the bound below which 90 % of the errors lie to the calibrated rms error.
    """
    ratio = _relative_errors(validation.weight, validation.residuals, validation.held_out_variance)
    return calibrate(ratio, validation.blocks, options.prior_blocks, options.min_expected_rms)


def _calibrate_by_simulation(
    ensemble: _Ensemble, factor: float, bound: float, options: EnsembleOptions
) -> tuple[float, float]:
    """Return factors that hold for simulated gaps as well; as given where there are none."""
    fitted = ensemble.fitted
    for number, problem in enumerate(fitted.problems):
        gaps = problem.simulated_gaps
        if not gaps:
            continue
        share = options.simulated.calibration_share(gaps)
        ratio = _relative_errors(*_in_simulated_gaps(ensemble, number))
        simulated, tail = calibrate(ratio, len(gaps), 0.0, options.min_expected_rms)
        factor = float(power(factor, 1.0 - share) * power(simulated, share))
        bound = float(power(bound, 1.0 - share) * power(tail, share))
    return factor, bound


def _relative_error(ensemble: _Ensemble, options: EnsembleOptions) -> float:
    """Return the ratio of the error to that of the clip's own problem; see `Regression`."""
    fitted, weight = ensemble.fitted, ensemble.total_weight / ensemble.total_weight.sum()
    if not any(problem.simulated_gaps for problem in fitted.problems):
        return float("nan")
    own = np.flatnonzero(fitted.problem_of == 0)
    held_out = np.maximum(_held_out_errors(fitted.models, ensemble.targets), MIN_MODEL_ERROR)
    ratio = float(log(weight @ held_out)) - _level(held_out[own], options)
    found = float("nan")
    for number, problem in enumerate(fitted.problems):
        gaps = problem.simulated_gaps
        if not gaps:
            continue
        share = options.simulated.level_share(gaps)
        shares, residuals, _ = _in_simulated_gaps(ensemble, number)
        simulated = log_ratio_to_own(residuals, shares, gaps)
        simulated += options.simulated.own_bias * (1.0 - shares[0])
        found = float(exp((1.0 - share) * ratio + share * simulated))
    return found


def _in_simulated_gaps(
    ensemble: _Ensemble, number: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return weights, residuals and predicted variances in the simulated gaps of a problem.

    Parameters
    ----------
    ensemble : _Ensemble
        Of positions, with its weights in the gap.
    number : int
        Of the problem.

    Returns
    -------
    weight : ndarray [shape=(models + 1,)]
        Of the clip's own problem as a whole, then of the problem's models; sum 1.
    residuals : ndarray [shape=(models + 1, poses of all gaps, missing markers, 3), mm]
    variance : ndarray [shape=(models + 1, poses of all gaps, missing markers), mm²]
    """
    fitted, targets = ensemble.fitted, ensemble.targets
    gaps = fitted.problems[number].simulated_gaps
    some = np.flatnonzero(fitted.problem_of == number)
    models = [fitted.models[k] for k in some]
    own = float(ensemble.total_weight[fitted.problem_of == 0].sum())
    weight = np.concatenate([[own], ensemble.total_weight[some]])
    weight = weight / weight.sum()
    own_residuals = np.concatenate([gap.own_residuals for gap in gaps])
    own_variance = np.concatenate([gap.own_rms for gap in gaps]) ** 2
    residuals = np.stack([own_residuals, *(m.simulated_residuals[:, targets] for m in models)])
    variance = np.stack([own_variance, *(m.simulated_variance[:, targets] for m in models)])
    return weight, residuals, variance


def _relative_errors(
    weight: NDArray[np.float64], residuals: NDArray[np.float64], variance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return errors of a weighted mean in units of its predicted rms error.

    Parameters
    ----------
    weight : ndarray [shape=(models,)]
        Sum 1.
    residuals : ndarray [shape=(models, poses, targets, 3)]
        Of each model.
    variance : ndarray [shape=(models, poses, targets)]
        Predicted by each model.
    """
    mean = np.einsum("k,krmi->rmi", weight, residuals)
    disagreement = ((residuals - mean) ** 2).sum(axis=3)
    total = np.einsum("k,krm->rm", weight, variance + disagreement)
    ratio: NDArray[np.float64] = np.sqrt((mean**2).sum(axis=2) / np.maximum(total, MIN_VARIANCE))
    return ratio


def _predicted_velocity(
    ensemble: _Ensemble, positions: _CrossValidation, options: EnsembleOptions
) -> VelocityPrediction:
    """Return an ensemble's velocities and their expected errors.

    The expected rms error is the geometric mean of the error that the models predict and the rms
    error of held-out velocities of similar speed.
    """
    validation = ensemble.cross_validate()
    residuals = validation.ensemble_residuals
    by_speed = error_by_speed(
        ensemble.mean, validation.velocity - residuals, residuals, options.velocity_errors
    )
    position_rms = np.sqrt((positions.ensemble_residuals**2).sum(axis=2).mean(axis=0))
    return VelocityPrediction(
        ensemble.mean,
        np.sqrt(ensemble.predicted_rms * by_speed),
        np.maximum(position_rms, options.min_expected_rms),
    )

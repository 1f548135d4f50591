"""Models of one alignment, fitted to a regression problem.

The cost of fitting depends on the number of training poses alone. Queries are predicted in
batches, so that long gaps need no more memory than short ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootFrames
from priorfill.gp.features import Alignment, LagFeature, MarkerWeights
from priorfill.gp.kernels import Kernel, Pairs, SameSubject
from priorfill.gp.problem import GPModel, PoseSamples, RegressionProblem
from priorfill.gp.process import FittedGP, GaussianProcess

__all__ = ["FittedModel", "FittedModels", "Predictions", "SharedCovariances"]

_Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SharedCovariances:
    """What all models of a problem share, whatever their alignment.

    Attributes
    ----------
    blocks : list of ndarray of int
        Training poses that are held out together.
    held_out : ndarray of int
        The training poses of all blocks, in order of time.
    simulated : list of ndarray of int
        Training poses of each simulated gap.
    pairs : Pairs
        Of the training poses, with the covariances in time of all kernels.
    """

    blocks: list[NDArray[np.intp]]
    held_out: NDArray[np.intp]
    simulated: list[NDArray[np.intp]]
    pairs: Pairs
    _problem: RegressionProblem
    _kernels: tuple[Kernel, ...]

    @classmethod
    def of(
        cls, problem: RegressionProblem, models: Iterable[GPModel], block_seconds: float
    ) -> SharedCovariances:
        """Compute what models share, with held-out blocks of some length (s)."""
        train = problem.train
        blocks = train.blocks(block_seconds, problem.query)
        held_out = np.concatenate(blocks)
        held_out = held_out[np.argsort(train.time[held_out], kind="stable")]
        processes = dict.fromkeys(_with_offset(model.process, problem) for model in models)
        kernels = tuple(process.kernel for process in processes)
        simulated = [gap.rows for gap in problem.simulated_gaps]
        pairs = _precomputed(train.pairs(train), kernels)
        return cls(blocks, held_out, simulated, pairs, problem, kernels)

    def query_pairs(self, query: PoseSamples) -> Pairs:
        """Return the pairs of queries with the training poses, and their covariances in time."""
        return _precomputed(query.pairs(self._problem.train), self._kernels)


def _with_offset(process: GaussianProcess, problem: RegressionProblem) -> GaussianProcess:
    """Add a problem's offsets of subjects to the covariance of a process."""
    if problem.offset_variance == 0.0:
        return process
    return replace(process, kernel=process.kernel + problem.offset_variance * SameSubject())


def _precomputed(pairs: Pairs, kernels: Iterable[Kernel]) -> Pairs:
    """Compute the parts of kernels that do not depend on features, once for all alignments."""
    for kernel in kernels:
        kernel.precompute(pairs)
    return pairs


@dataclass(frozen=True, eq=False)
class Predictions:
    """Predictions of several models: positions (mm), then velocities (mm/s) if these are targets.

    Attributes
    ----------
    mean : ndarray [shape=(models, queries, targets, 3)]
        Upright.
    variance : ndarray [shape=(models, queries, targets)]
        Expected square error (Euclidean).
    relative_std : ndarray [shape=(models, queries)]
        Predicted standard deviation in units of its root mean square over the held-out poses.
    """

    mean: NDArray[np.float64]
    variance: NDArray[np.float64]
    relative_std: NDArray[np.float64]

    @classmethod
    def empty(cls, models: int, queries: int, targets: int) -> Predictions:
        """Return predictions to be filled in."""
        return cls(
            np.empty((models, queries, targets, 3)),
            np.empty((models, queries, targets)),
            np.empty((models, queries)),
        )


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A model fitted to the training poses, and its cross-validation.

    Attributes
    ----------
    residuals : ndarray [shape=(held-out poses, targets, 3), mm and mm/s]
        Upright; of the positions, then of the velocities, each block predicted from the others.
    held_out_variance : ndarray [shape=(held-out poses, targets), mm² and mm²/s²]
        Their predicted variance (Euclidean).
    simulated_residuals, simulated_variance : ndarray
        The same of the simulated gaps, one gap after the other.
    """

    residuals: NDArray[np.float64]
    held_out_variance: NDArray[np.float64]
    simulated_residuals: NDArray[np.float64]
    simulated_variance: NDArray[np.float64]
    _fitted: FittedGP
    _noise_variance: float
    _unit: _Floats  # (targets,), mm² or (mm/s)² of one unit of the kernel
    _mean_variance: float  # of the held-out poses, in the kernel's unit

    @classmethod
    def fit(
        cls,
        process: GaussianProcess,
        pairs: Pairs,
        targets: _Floats,
        rotation: _Floats,
        shared: SharedCovariances,
    ) -> FittedModel:
        """Fit a process and hold out blocks.

        Parameters
        ----------
        process : GaussianProcess
            With offsets of subjects, if any.
        pairs : Pairs
            Of the training poses, with features.
        targets : ndarray [shape=(training poses, targets * 3)]
            In the root frames, centred.
        rotation : ndarray [shape=(training poses, 3, 3)]
            Of the root frames.
        shared : SharedCovariances
            Of the problem.
        """
        fitted = process.fit(pairs, targets)
        held_out = shared.held_out
        local, variance = fitted.leave_blocks_out(shared.blocks)
        residuals = local[held_out].reshape(len(held_out), -1, 3)
        left = variance[held_out, None]
        # the scale of the covariance of each target, by cross-validation [RW06, section 5.4.2]
        unit = ((residuals**2).sum(axis=2) / left).mean(axis=0)
        simulated = np.concatenate([held_out[:0], *shared.simulated])
        gap_residuals, gap_variance = residuals[:0], left[:0]
        if len(simulated):
            local, variance = fitted.leave_blocks_out(shared.simulated)
            gap_residuals = local[simulated].reshape(len(simulated), -1, 3)
            gap_variance = variance[simulated, None]
        return cls(
            residuals @ np.swapaxes(rotation[held_out], 1, 2),
            left * unit,
            gap_residuals @ np.swapaxes(rotation[simulated], 1, 2),
            gap_variance * unit,
            fitted,
            process.noise_variance,
            unit,
            float(left.mean()),
        )

    def predict(
        self, pairs: Pairs
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Predict queries.

        Parameters
        ----------
        pairs : Pairs
            Of the queries with the training poses, with features.

        Returns
        -------
        mean : ndarray [shape=(queries, targets * 3)]
            In the root frames, centred.
        variance : ndarray [shape=(queries, targets)]
        relative_std : ndarray [shape=(queries,)]
            As of `Predictions`.
        """
        mean, latent = self._fitted.predict(pairs)
        variance = latent + self._noise_variance
        return (
            mean,
            variance[:, None] * self._unit,
            np.sqrt(variance / self._mean_variance),
        )


@dataclass(frozen=True, eq=False)
class _Features:
    """Features of the training poses, centred."""

    train: _Floats  # (training poses, features)
    mean: _Floats  # (features,)

    @classmethod
    def of(cls, features: _Floats) -> _Features:
        """Centre features."""
        mean = features.mean(axis=0)
        return cls(features - mean, mean)

    @property
    def product(self) -> _Floats:
        """Inner products of the training poses' features."""
        product: _Floats = self.train @ self.train.T
        return product

    def with_query(self, features: _Floats) -> tuple[_Floats, _Floats]:
        """Return inner products of queries' and training poses' features, and squared norms."""
        centred = features - self.mean
        return centred @ self.train.T, (centred**2).sum(axis=1)


@dataclass(frozen=True, eq=False)
class _AlignedFeatures:
    """The training poses in the root frames of an alignment, and their features."""

    alignment: Alignment
    weights: MarkerWeights
    template: _Floats  # (visible markers, 3), mm
    frames: RootFrames  # of the training poses
    poses: _Features
    lags: dict[LagFeature, _Features]

    @classmethod
    def of(
        cls, alignment: Alignment, problem: RegressionProblem, lags: Iterable[LagFeature]
    ) -> _AlignedFeatures:
        """Align the training poses of a problem."""
        train = problem.train
        weights = alignment.marker_weights(problem.distance, problem.spread)
        template = train.visible[len(train.visible) // 2]
        frames = alignment.root_frames(train.visible, template, weights)
        return cls(
            alignment,
            weights,
            template,
            frames,
            _Features.of(_features(train, frames, weights.features, None)),
            {lag: _Features.of(_features(train, frames, weights.features, lag)) for lag in lags},
        )

    def targets(self, train: PoseSamples) -> _Floats:
        """Return positions, and velocities if known, in the root frames [shape=(poses, -1)]."""
        targets = self.frames.to_local(train.missing)
        if train.velocity is not None:
            velocity = train.velocity @ self.frames.rotation
            targets = np.concatenate([targets, velocity], axis=1)
        return targets.reshape(len(train.time), -1)

    def query_frames(self, query: PoseSamples) -> RootFrames:
        """Return the root frames of queries."""
        return self.alignment.root_frames(query.visible, self.template, self.weights)


@dataclass(frozen=True, eq=False)
class FittedModels:
    """The models of one alignment, fitted to a problem.

    Attributes
    ----------
    fitted : tuple of FittedModel
        Each model.
    shared : SharedCovariances
        What they share with the models of other alignments.
    """

    fitted: tuple[FittedModel, ...]
    shared: SharedCovariances
    _models: tuple[GPModel, ...]
    _aligned: _AlignedFeatures
    _centre: _Floats  # (targets * 3,), mean of the targets
    _norms: dict[LagFeature | None, _Floats]  # (training poses,), scaled
    _scales: dict[LagFeature | None, float]
    _positions: int  # number of targets that are positions

    @classmethod
    def fit(
        cls,
        alignment: Alignment,
        problem: RegressionProblem,
        models: Sequence[GPModel],
        shared: SharedCovariances,
    ) -> FittedModels:
        """Fit models of one alignment; those of one lag feature must follow each other."""
        lags = dict.fromkeys(m.lag_feature for m in models if m.lag_feature is not None)
        aligned = _AlignedFeatures.of(alignment, problem, lags)
        targets = aligned.targets(problem.train)
        centre = targets.mean(axis=0)
        targets = targets - centre
        product_of_poses = aligned.poses.product
        norms: dict[LagFeature | None, _Floats] = {}
        scales: dict[LagFeature | None, float] = {}
        fitted = []
        for lag, group in groupby(models, key=lambda model: model.lag_feature):
            product = product_of_poses
            if lag is not None:
                product = product + aligned.lags[lag].product
            scales[lag] = _mean_squared_norm(product)
            product = product / scales[lag]
            norms[lag] = np.diag(product)
            pairs = shared.pairs.with_features(product, norms[lag], norms[lag])
            fitted += [
                FittedModel.fit(
                    _with_offset(model.process, problem),
                    pairs,
                    targets,
                    aligned.frames.rotation,
                    shared,
                )
                for model in group
            ]
        return cls(
            tuple(fitted),
            shared,
            tuple(models),
            aligned,
            centre,
            norms,
            scales,
            problem.train.missing.shape[1],
        )

    def predict(self, query: PoseSamples, pairs: Pairs) -> Predictions:
        """Predict queries with all models.

        Parameters
        ----------
        query : PoseSamples
            The queries, with lagged positions if a model needs them.
        pairs : Pairs
            Of them with the training poses; see `SharedCovariances.query_pairs`.
        """
        aligned = self._aligned
        frames = aligned.query_frames(query)
        count, targets = len(query.time), len(self._centre) // 3
        found = Predictions.empty(len(self.fitted), count, targets)

        def inner_products(features: _Features, lag: LagFeature | None) -> tuple[_Floats, _Floats]:
            return features.with_query(_features(query, frames, aligned.weights.features, lag))

        product_of_poses, norm_of_poses = inner_products(aligned.poses, None)
        numbered = enumerate(self._models)
        for lag, group in groupby(numbered, key=lambda pair: pair[1].lag_feature):
            product, norm = product_of_poses, norm_of_poses
            if lag is not None:
                product_of_lag, norm_of_lag = inner_products(aligned.lags[lag], lag)
                product, norm = product + product_of_lag, norm + norm_of_lag
            scale = self._scales[lag]
            featured = pairs.with_features(product / scale, norm / scale, self._norms[lag])
            for number, _ in group:
                local, found.variance[number], found.relative_std[number] = self.fitted[
                    number
                ].predict(featured)
                found.mean[number] = (local + self._centre).reshape(count, targets, 3)
        found.mean[:] = found.mean @ np.swapaxes(frames.rotation, 1, 2)
        found.mean[:, :, : self._positions] += frames.origin[:, None, :]
        return found


def _mean_squared_norm(product: _Floats) -> float:
    """Return the mean squared norm of poses by their inner products; 1 if all norms are 0."""
    return float(np.trace(product)) / len(product) or 1.0


def _features(
    poses: PoseSamples, frames: RootFrames, weights: _Floats, lag: LagFeature | None
) -> _Floats:
    """Return features of poses, or those of a lag [shape=(poses, features)]."""
    if lag is None:
        parts = [frames.to_local(poses.visible)]
    elif lag.velocity:
        before, after = poses.lagged[lag.seconds]
        parts = [lag.weight * ((after - before) @ frames.rotation)]
    else:
        parts = [lag.weight * frames.to_local(x) for x in poses.lagged[lag.seconds]]
    weighted = np.concatenate([part * weights[:, None] for part in parts], axis=1)
    return weighted.reshape(len(weighted), -1)

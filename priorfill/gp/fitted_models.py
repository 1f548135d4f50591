"""Models of one alignment, fitted to a regression problem.

The cost of fitting depends on the number of training poses alone. Queries are predicted in
batches, so that long gaps need no more memory than short ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootFrames
from priorfill.gp.features import Alignment, LagFeature, MarkerWeights
from priorfill.gp.kernels import Kernel, Pairs, SameSubject
from priorfill.gp.linalg import joined_blocks, positive_definite, solve_indefinite_blocks
from priorfill.gp.pose_process import PoseProcess
from priorfill.gp.problem import GPModel, PoseSamples, RegressionProblem

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
    order : ndarray of int
        Their places where the blocks follow one another.
    simulated : list of ndarray of int
        Training poses of each simulated gap.
    train : tuple of ndarray [shapes=(factors, poses, poses), (added, poses, poses)]
        By what covariances of training poses are multiplied, and what is added to them; see
        `priorfill.gp.pose_process.PoseProcess`.
    """

    blocks: list[NDArray[np.intp]]
    held_out: NDArray[np.intp]
    order: NDArray[np.intp]
    simulated: list[NDArray[np.intp]]
    train: tuple[_Floats, _Floats]
    _problem: RegressionProblem
    _factors: tuple[Kernel, ...]
    _added: tuple[Kernel, ...]

    @classmethod
    def of(
        cls, problem: RegressionProblem, models: Sequence[GPModel], block_seconds: float
    ) -> SharedCovariances:
        """Compute what models share, with held-out blocks of some length (s)."""
        train = problem.train
        blocks = train.blocks(block_seconds, problem.query)
        held_out = np.concatenate(blocks)
        order = np.argsort(train.time[held_out], kind="stable")
        pairs = train.pairs(train)
        factors = tuple(dict.fromkeys(model.process.factor for model in models))
        added = tuple(dict.fromkeys(model.process.of_time for model in models))
        simulated = [gap.rows for gap in problem.simulated_gaps]
        offset = problem.offset_variance
        both = _matrices(pairs, factors), _matrices(pairs, added, offset)
        return cls(blocks, held_out[order], order, simulated, both, problem, factors, added)

    def with_query(self, query: PoseSamples) -> tuple[_Floats, _Floats]:
        """Return the same as `train` of queries with the training poses."""
        pairs = query.pairs(self._problem.train)
        offset = self._problem.offset_variance
        return _matrices(pairs, self._factors), _matrices(pairs, self._added, offset)

    def places(self, process: PoseProcess) -> tuple[int, int]:
        """Return the numbers of a process's factor and of what it adds."""
        return self._factors.index(process.factor), self._added.index(process.of_time)

    def added_variance(self, process: PoseProcess) -> float:
        """Return the variance of what a process adds to the covariance of poses."""
        nowhere = Pairs((0, 0))
        return float(np.max(process.of_time.variance(nowhere))) + self._problem.offset_variance


def _matrices(pairs: Pairs, kernels: Sequence[Kernel], offset_variance: float = 0.0) -> _Floats:
    """Return the matrices of kernels, plus offsets of subjects [shape=(kernels, a, b)]."""
    found = np.empty((len(kernels), *pairs.shape))
    for matrix, kernel in zip(found, kernels, strict=True):
        matrix[:] = pairs.value(kernel)
        if offset_variance:
            matrix += pairs.value(offset_variance * SameSubject())
    return found


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


@dataclass(frozen=True, eq=False)
class FittedModel:
    """Cross-validation of a model fitted to the training poses.

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
        return centred @ self.train.T, np.einsum("qf,qf->q", centred, centred)


@dataclass(frozen=True, eq=False)
class _AlignedFeatures:
    """The training poses in the root frames of an alignment, and their features."""

    alignment: Alignment
    weights: MarkerWeights
    template: _Floats  # (visible markers, 3), mm
    frames: RootFrames  # of the training poses
    poses: _Features
    lags: tuple[LagFeature | None, ...]
    lagged: tuple[_Features | None, ...]  # of each lag; None without one

    @classmethod
    def of(
        cls,
        alignment: Alignment,
        problem: RegressionProblem,
        lags: tuple[LagFeature | None, ...],
    ) -> _AlignedFeatures:
        """Align the training poses of a problem; the features of poses may be without a lag."""
        train = problem.train
        weights = alignment.marker_weights(problem.distance, problem.spread)
        template = train.visible[len(train.visible) // 2]
        frames = alignment.root_frames(train.visible, template, weights)
        lagged = [
            None if lag is None else _Features.of(_features(train, frames, weights.features, lag))
            for lag in lags
        ]
        poses = _Features.of(_features(train, frames, weights.features, None))
        return cls(alignment, weights, template, frames, poses, lags, tuple(lagged))

    @property
    def products(self) -> _Floats:
        """Inner products of all features, with each lag [shape=(lags, poses, poses)]."""
        product = self.poses.product
        products = np.empty((len(self.lags), *product.shape))
        for total, features in zip(products, self.lagged, strict=True):
            total[:] = product
            if features is not None:
                total += features.product
        return products

    def with_query(self, query: PoseSamples, frames: RootFrames) -> tuple[_Floats, _Floats]:
        """Return inner products of queries with training poses, and squared norms, by lag.

        Parameters
        ----------
        query : PoseSamples
            With lagged positions.
        frames : RootFrames
            Their root frames.

        Returns
        -------
        products : ndarray [shape=(lags, queries, poses)]
        norms : ndarray [shape=(lags, queries)]
        """
        weights = self.weights.features
        product, norm = self.poses.with_query(_features(query, frames, weights, None))
        products = np.empty((len(self.lags), *product.shape))
        norms = np.empty((len(self.lags), len(norm)))
        for place, (lag, features) in enumerate(zip(self.lags, self.lagged, strict=True)):
            products[place], norms[place] = product, norm
            if features is not None:
                more = features.with_query(_features(query, frames, weights, lag))
                products[place] += more[0]
                norms[place] += more[1]
        return products, norms

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
class _Processes:
    """Models of one alignment as `priorfill.gp.model_kernels` has them, fitted or to be fitted."""

    terms: _Floats  # (models, 4)
    places: NDArray[np.intp]  # (models, 3)
    added_variance: _Floats  # (models,)
    lags: tuple[LagFeature | None, ...]

    @classmethod
    def of(cls, models: Sequence[GPModel], shared: SharedCovariances) -> _Processes:
        """Collect the terms of models."""
        lags = tuple(dict.fromkeys(model.lag_feature for model in models))
        processes = [model.process for model in models]
        return cls(
            np.array(
                [(p.linear, p.rbf, -0.5 / p.length_scale**2, p.noise_variance) for p in processes]
            ),
            np.array(
                [(lags.index(m.lag_feature), *shared.places(m.process)) for m in models],
                dtype=np.intp,
            ),
            np.array([shared.added_variance(process) for process in processes]),
            lags,
        )

    def one(self, number: int) -> _Processes:
        """Return one of them alone."""
        some = slice(number, number + 1)
        return _Processes(self.terms[some], self.places[some], self.added_variance[some], self.lags)

    def covariances(
        self,
        features: tuple[_Floats, _Floats, _Floats],
        shared: tuple[_Floats, _Floats],
        upper: bool = False,
    ) -> _Floats:
        """Return the covariances by each model; see `priorfill.gp.model_kernels.covariances`."""
        from priorfill.gp.model_kernels import covariances  # llvmlite is slow to import

        _, one, other = features[0].shape
        result = np.empty((len(self.terms), one, other))
        models, work = (self.terms, self.places), (np.zeros((one, other)), np.empty(other))
        covariances(features, shared, models, upper, work, result)
        return result

    def prior_variance(self, norms: _Floats) -> _Floats:
        """Return the variance of queries, noise included [shape=(models, queries)].

        Parameters
        ----------
        norms : ndarray [shape=(lags, queries)]
            Squared norms of their features.
        """
        linear, rbf, _, noise = self.terms.T
        constant = 1.0 + rbf + self.added_variance + noise
        variance: _Floats = constant[:, None] + linear[:, None] * norms[self.places[:, 0]]
        return variance


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
    _processes: _Processes
    _aligned: _AlignedFeatures
    _centre: _Floats  # (targets * 3,), mean of the targets
    _scales: _Floats  # (lags,), of the features
    _norms: _Floats  # (lags, training poses), scaled
    _roots: _Floats  # (models, training poses, training poses)
    _weights: _Floats  # (models, training poses, targets * 3)
    _units: _Floats  # (models, targets), mm² or (mm/s)² of one unit of the kernel
    _mean_variance: _Floats  # (models,), of the held-out poses, in the kernel's unit
    _positions: int  # number of targets that are positions

    @classmethod
    def fit(
        cls,
        alignment: Alignment,
        problem: RegressionProblem,
        models: Sequence[GPModel],
        shared: SharedCovariances,
    ) -> FittedModels:
        """Fit models of one alignment.

        Raises
        ------
        numpy.linalg.LinAlgError
            Where a covariance matrix is not positive definite, even with jitter.
        """
        processes = _Processes.of(models, shared)
        aligned = _AlignedFeatures.of(alignment, problem, processes.lags)
        targets = aligned.targets(problem.train)
        centre = targets.mean(axis=0)
        targets -= centre
        products = aligned.products
        scales = np.array([_mean_squared_norm(product) for product in products])
        products /= scales[:, None, None]
        norms = np.einsum("lii->li", products).copy()
        roots, weights, residuals, variance = _fit(processes, (products, norms), targets, shared)
        samples = np.concatenate([shared.held_out, *shared.simulated])
        residuals = _upright(residuals, aligned.frames.rotation[samples])
        held_out, simulated = slice(len(shared.held_out)), slice(len(shared.held_out), None)
        # the scale of the covariance of each target, by cross-validation [RW06, section 5.4.2]
        square = (residuals[:, held_out] ** 2).sum(axis=3)
        units = (square / variance[:, held_out, None]).mean(axis=1)
        scaled = variance[:, :, None] * units[:, None]
        fitted = map(
            FittedModel,
            residuals[:, held_out],
            scaled[:, held_out],
            residuals[:, simulated],
            scaled[:, simulated],
        )
        return cls(
            tuple(fitted),
            shared,
            processes,
            aligned,
            centre,
            scales,
            norms,
            roots,
            weights,
            units,
            variance[:, held_out].mean(axis=1),
            problem.train.missing.shape[1],
        )

    def predict(self, query: PoseSamples, covariances: tuple[_Floats, _Floats]) -> Predictions:
        """Predict queries with all models.

        Parameters
        ----------
        query : PoseSamples
            The queries, with lagged positions if a model needs them.
        covariances : tuple of ndarray
            See `SharedCovariances.with_query`.
        """
        from priorfill.gp.model_kernels import predict_models  # llvmlite is slow to import
        from priorfill.gp.triangular_kernels import blas_work

        aligned, processes = self._aligned, self._processes
        frames = aligned.query_frames(query)
        products, norms = aligned.with_query(query, frames)
        products /= self._scales[:, None, None]
        norms /= self._scales[:, None]
        cross = processes.covariances((products, norms, self._norms), covariances)
        models, targets = self._units.shape
        mean = np.empty((models, len(query.time), 3 * targets))
        explained = np.empty(mean.shape[:2])
        predict_models(cross, (self._roots, self._weights), blas_work(), mean, explained)
        noise = processes.terms[:, -1:]
        variance = np.maximum(processes.prior_variance(norms) - explained, noise)
        mean += self._centre
        found = Predictions(
            _upright(mean, frames.rotation),
            variance[:, :, None] * self._units[:, None],
            np.sqrt(variance / self._mean_variance[:, None]),
        )
        found.mean[:, :, : self._positions] += frames.origin[:, None, :]
        return found


def _fit(
    processes: _Processes,
    features: tuple[_Floats, _Floats],
    targets: _Floats,
    shared: SharedCovariances,
) -> tuple[_Floats, _Floats, _Floats, _Floats]:
    """Fit models, and hold out blocks and simulated gaps; see `fit_models`.

    Returns
    -------
    roots, weights : ndarray
        As of `FittedModels`.
    residuals : ndarray [shape=(models, held-out poses, targets * 3)]
    variance : ndarray [shape=(models, held-out poses)]
        Of `SharedCovariances.held_out`, then of the simulated gaps.
    """
    from priorfill.gp.model_kernels import fit_models  # llvmlite is slow to import
    from priorfill.gp.triangular_kernels import blas_work

    models, (poses, outputs) = len(processes.terms), targets.shape
    blocks = [*shared.blocks, *shared.simulated]
    samples, edges = joined_blocks(blocks)
    longest = max(map(len, blocks))
    work = np.empty((longest, poses)), np.empty((longest, longest)), blas_work()
    known = (*features, features[1])
    roots = processes.covariances(known, shared.train, upper=True)
    weights = np.repeat(targets[None], models, axis=0)
    residuals, variance = (
        np.empty((models, len(samples), outputs)),
        np.empty((models, len(samples))),
    )
    rest = (samples, edges), work, (roots, weights), (residuals, variance)
    fitted = fit_models(0, *rest)
    while fitted < models:
        again = processes.one(fitted).covariances(known, shared.train, upper=True)
        roots[fitted] = positive_definite(again[0])
        fitted = fit_models(fitted, *rest)
    for k in np.flatnonzero(np.isnan(variance).any(axis=1)):
        solve_indefinite_blocks(roots[k], weights[k], blocks, None, residuals[k], variance[k])
    order = np.concatenate([shared.order, np.arange(len(shared.order), len(samples))])
    return roots, weights, residuals[:, order], variance[:, order]


def _upright(local: _Floats, rotation: _Floats) -> _Floats:
    """Return vectors in root frames [shape=(models, poses, targets * 3)] in upright axes.

    Returns
    -------
    ndarray [shape=(models, poses, targets, 3)]
    """
    vectors = local.reshape(*local.shape[:2], local.shape[2] // 3, 3)
    upright: _Floats = np.einsum("mpti,pji->mptj", vectors, rotation)
    return upright


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

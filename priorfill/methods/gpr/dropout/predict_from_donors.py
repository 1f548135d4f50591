"""Gaussian-process regression from the visible to the missing markers of several subjects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootFrames
from priorfill.gp.calibration import MIN_EXPECTED_RMS
from priorfill.gp.features import Alignment
from priorfill.gp.kernels import Pairs
from priorfill.gp.linalg import power_weights
from priorfill.gp.process import FittedGP
from priorfill.methods.gpr.dropout.donors import Donor
from priorfill.methods.gpr.dropout.marker_coupling import MarkerCoupling
from priorfill.methods.gpr.dropout.multi_subject_kernel import subject_pairs
from priorfill.methods.gpr.dropout.options import DropoutOptions
from priorfill.methods.gpr.dropout.subjects import THIS_CLIP

__all__ = ["DonorPredictions", "predict_from_donors", "predict_with_each_model"]

_Floats = NDArray[np.float64]

MIN_ERROR = 1e-9
"""mm. Keeps the weight of a model without any error finite."""

QUERY_BATCH = 500
"""Query poses predicted at a time, to bound memory."""


@dataclass(frozen=True, eq=False)
class DonorPredictions:
    """Predictions of each model.

    Attributes
    ----------
    positions : ndarray [shape=(models, poses, missing markers, 3), mm]
        Upright.
    variance : ndarray [shape=(models, poses, missing markers), mm²]
        Expected squared Euclidean error.
    errors : ndarray [shape=(models,), mm]
        Rms error with subjects held out; NaN where none was.
    """

    positions: _Floats
    variance: _Floats
    errors: _Floats


def predict_from_donors(
    donors: Sequence[Donor],
    query: _Floats,
    coupling: MarkerCoupling,
    options: DropoutOptions,
    errors: _Floats | None = None,
) -> tuple[_Floats, _Floats]:
    """Predict missing markers from donors.

    Parameters
    ----------
    donors : sequence of Donor
        At least one.
    query : ndarray [shape=(poses, visible markers, 3), mm]
        The clip's visible markers.
    coupling : MarkerCoupling
        Of the missing markers to the visible ones.
    options : DropoutOptions
        The models and their weighting.
    errors : ndarray [shape=(models,), mm], optional
        Expected error of each model. By default it is cross-validated: each subject of the
        database is predicted from the others.

    Returns
    -------
    positions : ndarray [shape=(poses, missing markers, 3), mm]
        Upright; mean of the models' predictions, weighted by their errors.
    expected_rms : ndarray [shape=(poses, missing markers), mm]
        Expected rms Euclidean error: the models' variances and their disagreement.

    See Also
    --------
    priorfill.methods.gpr.dropout.donors.Donors : Finds the donors.
    predict_with_each_model : The predictions that are averaged.
    """
    found = predict_with_each_model(donors, query, coupling, options, errors)
    weights = power_weights(np.maximum(found.errors, MIN_ERROR), options.weight_power)
    mean = np.einsum("k,kqmi->qmi", weights, found.positions)
    variance = found.variance + ((found.positions - mean) ** 2).sum(axis=3)
    expected_rms = np.sqrt(np.einsum("k,kqm->qm", weights, variance))
    return mean, np.maximum(expected_rms, MIN_EXPECTED_RMS)


def predict_with_each_model(
    donors: Sequence[Donor],
    query: _Floats,
    coupling: MarkerCoupling,
    options: DropoutOptions,
    errors: _Floats | float | None,
) -> DonorPredictions:
    """Predict missing markers with each alignment and process.

    Parameters are those of `predict_from_donors`; with ``errors`` given, they also replace the
    predicted variances.
    """
    training = _TrainingPoses.of(donors, query, coupling, options)
    parts = [
        _predict_aligned(alignment, training, query, coupling, options, errors is None)
        for alignment in options.alignments
    ]
    found = DonorPredictions(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.variance for part in parts]),
        np.concatenate([part.errors for part in parts]),
    )
    if errors is None:
        return found
    given = np.broadcast_to(errors, found.errors.shape).astype(np.float64)
    variance = np.broadcast_to(given[:, None, None] ** 2, found.variance.shape)
    return DonorPredictions(found.positions, variance, given)


@dataclass(frozen=True, eq=False)
class _TrainingPoses:
    """Poses of all donors. The clip itself is the last entry of subject, mirrored and shapes."""

    visible: _Floats  # (poses, visible, 3)
    missing: _Floats  # (poses, missing, 3)
    donor: NDArray[np.intp]  # (poses,) number of the donor
    subject: NDArray[np.intp]  # (donors + 1,)
    mirrored: NDArray[np.bool_]  # (donors + 1,)
    shapes: _Floats  # (donors + 1, pairs of visible markers)
    _pairs: dict[int | None, Pairs] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        donors: Sequence[Donor],
        query: _Floats,
        coupling: MarkerCoupling,
        options: DropoutOptions,
    ) -> _TrainingPoses:
        # all recordings of the clip's subject have the shape seen in the clip
        poses = [*(query if d.is_own else d.visible for d in donors), query]
        return cls(
            np.concatenate([d.visible for d in donors]),
            np.concatenate([d.missing for d in donors]),
            np.repeat(np.arange(len(donors)), [len(d.visible) for d in donors]),
            np.array([*(d.subject for d in donors), THIS_CLIP]),
            np.array([*(d.mirrored for d in donors), False]),
            np.array([coupling.body_shape(p, options) for p in poses]),
        )

    @property
    def own(self) -> NDArray[np.bool_]:
        """Which poses are of the clip's own subject, not mirrored [shape=(poses,)]."""
        own: NDArray[np.bool_] = (self.subject == THIS_CLIP) & ~self.mirrored
        return own[self.donor]

    def pairs(self, queries: int | None = None) -> Pairs:
        """Return pairs of the training poses, or of a number of query poses with them.

        Query poses differ in their features only, so the pairs serve every batch and alignment.
        """
        if queries not in self._pairs:
            clip = len(self.subject) - 1
            one = self.donor if queries is None else np.full(queries, clip, dtype=np.intp)
            self._pairs[queries] = subject_pairs(
                self.shapes, self.subject, self.mirrored, one, self.donor
            )
        return self._pairs[queries]

    def held_out_blocks(self) -> list[NDArray[np.intp]]:
        """Return the poses that are held out together, for each subject of the database.

        A subject is predicted as the clip is: if the clip has a mirror image to learn from, then
        so has the subject, and only poses of the same side are held out.
        """
        subject, mirrored = self.subject[:-1], self.mirrored[:-1]
        with_image = bool(np.any((subject == THIS_CLIP) & mirrored))
        held_out = []
        for number in np.flatnonzero(subject != THIS_CLIP):
            same = np.flatnonzero(subject == subject[number])
            if with_image:
                same = np.array([number])
            elif number != same[0]:
                continue  # held out together with the first donor of the subject
            held_out.append(np.flatnonzero(np.isin(self.donor, same)))
        return held_out


@dataclass(frozen=True, eq=False)
class _AlignedPoses:
    """Features and targets of training and query poses in one alignment."""

    train: _Floats  # (poses, features), mean 0, mean square norm 1
    query: _Floats  # (query poses, features)
    query_frames: RootFrames
    targets: _Floats  # (poses, missing * 3), mm, relative to the centre
    centre: _Floats  # (missing * 3,), mm

    @classmethod
    def of(
        cls,
        alignment: Alignment,
        training: _TrainingPoses,
        query: _Floats,
        coupling: MarkerCoupling,
    ) -> _AlignedPoses:
        """Align poses with the middle query pose, and weight the visible markers."""
        weights = alignment.marker_weights(coupling.distance, coupling.spread)
        template = query[len(query) // 2]
        train_frames = alignment.root_frames(training.visible, template, weights)
        query_frames = alignment.root_frames(query, template, weights)

        def features(frames: RootFrames, poses: _Floats) -> _Floats:
            return (frames.to_local(poses) * weights.features[:, None]).reshape(len(poses), -1)

        train, queries = features(train_frames, training.visible), features(query_frames, query)
        mean = train.mean(axis=0)
        train, queries = train - mean, queries - mean
        scale = float(np.sqrt((train**2).sum(axis=1).mean())) or 1.0
        targets = train_frames.to_local(training.missing).reshape(len(train), -1)
        # deviations of other subjects are relative to the clip's own, where it is a donor
        centre = (targets[training.own] if training.own.any() else targets).mean(axis=0)
        return cls(train / scale, queries / scale, query_frames, targets - centre, centre)


def _predict_aligned(
    alignment: Alignment,
    training: _TrainingPoses,
    query: _Floats,
    coupling: MarkerCoupling,
    options: DropoutOptions,
    calibrate: bool,
) -> DonorPredictions:
    """Predict with each process in one alignment.

    With ``calibrate``, subjects are held out, and variances are scaled to their errors; else the
    variances are in units of the kernel and the errors NaN.
    """
    aligned = _AlignedPoses.of(alignment, training, query, coupling)
    train = training.pairs().with_features(*_products(aligned.train, aligned.train))
    blocks = training.held_out_blocks() if calibrate else []
    markers = aligned.targets.shape[1] // 3
    positions, variances, errors = [], [], []
    for process in options.processes:
        noise = process.noise_variance * np.where(training.own, options.own_noise_ratio, 1.0)
        fitted = process.fit(train, aligned.targets, noise_variance=noise)
        local, variance = _posterior(fitted, aligned, training)
        local = (local + aligned.centre).reshape(-1, markers, 3)
        positions.append(aligned.query_frames.to_world(local))
        scale, error = np.ones(markers), np.nan
        if calibrate:
            scale, error = _calibrate(fitted, blocks, markers)
        variances.append((variance + noise.min())[:, None] * scale)
        errors.append(error)
    return DonorPredictions(np.array(positions), np.array(variances), np.array(errors))


def _products(one: _Floats, other: _Floats) -> tuple[_Floats, _Floats, _Floats]:
    """Return inner products and squared norms of features, as for `Pairs.with_features`."""
    return one @ other.T, (one**2).sum(axis=1), (other**2).sum(axis=1)


def _posterior(
    fitted: FittedGP, aligned: _AlignedPoses, training: _TrainingPoses
) -> tuple[_Floats, _Floats]:
    """Return the posterior of the query poses.

    Returns
    -------
    mean : ndarray [shape=(query poses, missing * 3), mm]
        In the queries' frames, relative to the targets' centre.
    variance : ndarray [shape=(query poses,)]
        Without noise, in units of the kernel.
    """
    means, variances = [], []
    for start in range(0, len(aligned.query), QUERY_BATCH):
        query = aligned.query[start : start + QUERY_BATCH]
        cross = training.pairs(len(query)).with_features(*_products(query, aligned.train))
        mean, variance = fitted.predict(cross)
        means.append(mean)
        variances.append(variance)
    return np.concatenate(means), np.concatenate(variances)


def _calibrate(
    fitted: FittedGP, blocks: Sequence[NDArray[np.intp]], markers: int
) -> tuple[_Floats, float]:
    """Return the held-out squared error (mm²) per unit of variance, by marker, and the rms (mm)."""
    residuals, variance = fitted.leave_blocks_out(blocks)
    held_out = np.concatenate(blocks)
    square = (residuals[held_out].reshape(len(held_out), markers, 3) ** 2).sum(axis=2)
    scale = (square / variance[held_out][:, None]).mean(axis=0)
    return scale, float(np.sqrt(square.mean()))

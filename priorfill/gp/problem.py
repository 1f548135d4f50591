"""Regression problems: training poses, query poses, and the models that are fitted to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.features import Alignment, LagFeature
from priorfill.gp.kernels import Pairs
from priorfill.gp.pose_process import PoseProcess

__all__ = ["GPModel", "LagSource", "PoseSamples", "RegressionProblem", "SimulatedGap"]

MIN_BLOCK_SECONDS = 1e-3
"""s. Length of a held-out block at least; shorter than any frame."""


@dataclass(frozen=True)
class GPModel:
    """A model of the ensemble.

    Attributes
    ----------
    alignment : Alignment
        How poses are aligned.
    lag_feature : LagFeature or None
        Additional features.
    process : PoseProcess
        The regression from features to the coordinates of the missing markers. Features are
        centred, and scaled to a mean squared norm of 1.
    """

    alignment: Alignment
    lag_feature: LagFeature | None
    process: PoseProcess


@dataclass(frozen=True, eq=False)
class PoseSamples:
    """Poses for training, or to be predicted.

    Attributes
    ----------
    visible : ndarray [shape=(poses, visible markers, 3), mm]
        Upright, complete.
    missing : ndarray [shape=(poses, missing markers, 3), mm]
        The targets; no markers for poses to be predicted.
    time : ndarray [shape=(poses,), s]
        Time in the recording.
    recording : ndarray of int [shape=(poses,)]
        Number of the recording.
    correlation : ndarray [shape=(poses,)], optional
        Correlation of each pose's subject with that of the query: 1, the default, for the same
        subject.
    subject : ndarray of int [shape=(poses,)], optional
        Number of the subject; that of the recording by default.
    lagged : mapping of float to ndarray [shape=(2, poses, visible markers, 3), mm]
        By lag (s): the visible markers that long before and after, complete.
    velocity : ndarray [shape=(poses, missing markers, 3), mm/s], optional
        Velocities of the missing markers, which are further targets.
    """

    visible: NDArray[np.float64]
    missing: NDArray[np.float64]
    time: NDArray[np.float64]
    recording: NDArray[np.intp]
    correlation: NDArray[np.float64] | None = None
    subject: NDArray[np.intp] | None = None
    lagged: Mapping[float, NDArray[np.float64]] = field(default_factory=dict)
    velocity: NDArray[np.float64] | None = None

    def subset(self, chosen: slice) -> PoseSamples:
        """Return some of the poses."""
        return replace(
            self,
            visible=self.visible[chosen],
            missing=self.missing[chosen],
            time=self.time[chosen],
            recording=self.recording[chosen],
            correlation=None if self.correlation is None else self.correlation[chosen],
            subject=None if self.subject is None else self.subject[chosen],
            lagged={lag: positions[:, chosen] for lag, positions in self.lagged.items()},
            velocity=None if self.velocity is None else self.velocity[chosen],
        )

    def pairs(self, other: PoseSamples) -> Pairs:
        """Return the pairs of these poses (first set) with others, without features.

        Two subjects are correlated by the product of their correlations with the query's subject.
        Two recordings of one subject with different ones, such as of real and of virtual markers,
        are correlated by their ratio: they are a chain from the query over the more to the less
        correlated one, so that the covariance is positive definite.
        """
        lag = np.abs(self.time[:, None] - other.time)
        one = self.recording if self.subject is None else self.subject
        two = other.recording if other.subject is None else other.subject
        same_subject = one[:, None] == two
        correlation = None
        if self.correlation is not None or other.correlation is not None:
            first, second = self._correlations[:, None], other._correlations
            larger = np.maximum(first, second)
            ratio = np.ones_like(larger)
            np.divide(np.minimum(first, second), larger, out=ratio, where=larger > 0.0)
            correlation = np.where(same_subject, ratio, first * second)
        same_recording = self.recording[:, None] == other.recording
        return Pairs(
            (len(self.time), len(other.time)),
            time_lags=np.where(same_recording, lag, np.inf),
            same_subject=same_subject,
            same_recording=same_recording,
            correlation=correlation,
        )

    @property
    def _correlations(self) -> NDArray[np.float64]:
        """Correlation of each pose's subject with that of the query [shape=(poses,)]."""
        return np.ones(len(self.time)) if self.correlation is None else self.correlation

    def blocks(self, seconds: float, query: PoseSamples | None = None) -> list[NDArray[np.intp]]:
        """Divide the poses of the best correlated subject into blocks to be held out.

        Parameters
        ----------
        seconds : float
            Length of a block.
        query : PoseSamples, optional
            If given, only the recordings of these poses are divided, if any training pose is from
            them: in a gap, the other recordings of its subject remain.

        Returns
        -------
        list of ndarray of int
            Indices of the poses of each block.
        """
        number = np.floor(self.time / max(seconds, MIN_BLOCK_SECONDS)).astype(np.intp)
        _, block = np.unique(np.stack([self.recording, number]), axis=1, return_inverse=True)
        block = block.ravel()
        blocks = [np.flatnonzero(block == b) for b in range(block.max() + 1)]
        if self.correlation is None:
            return blocks
        divided = self.correlation == self.correlation.max()
        if query is not None:
            own = divided & np.isin(self.recording, query.recording)
            divided = own if own.any() else divided
        return [b for b in blocks if divided[b[0]]]


class LagSource(Protocol):
    """Adds the lagged positions to poses of the clip.

    For all queries of a long gap they would take many times the memory of the result, so they are
    added to one batch of queries at a time.
    """

    def __call__(self, poses: PoseSamples) -> PoseSamples:
        """Return poses with `PoseSamples.lagged`."""
        ...

    def restricted_to(self, visible: NDArray[np.intp]) -> LagSource:
        """Return the source for some of the visible markers only."""
        ...


@dataclass(frozen=True, eq=False)
class SimulatedGap:
    """Training poses of another recording that are held out together, as if they were the gap.

    Attributes
    ----------
    rows : ndarray of int
        The training poses, ascending.
    own_residuals : ndarray [shape=(poses, missing markers, 3), mm]
        Measured minus predicted positions, upright, of a prediction from the other poses of that
        recording alone.
    own_rms : ndarray [shape=(poses, missing markers), mm]
        Its expected rms error.
    likeness : float
        From 0 to 1, how far its errors are those of the gap; 1 for recordings of the same body.
    """

    rows: NDArray[np.intp]
    own_residuals: NDArray[np.float64]
    own_rms: NDArray[np.float64]
    likeness: float = 1.0


@dataclass(frozen=True, eq=False)
class RegressionProblem:
    """Training poses, and query poses with the same visible markers.

    Attributes
    ----------
    train : PoseSamples
        At least two blocks of the query's subject.
    query : PoseSamples
        The poses to be predicted; `lag_source` adds their lagged positions.
    distance, spread : ndarray [shape=(visible markers,), mm]
        Rms distance of each visible marker to the nearest missing one, and its standard deviation.
    error_penalty : float
        Factor of the cross-validated errors of models fitted to this problem, when they are
        weighted against those of other problems.
    offset_variance : float
        Variance of a constant offset of each subject, in the kernels' unit: other people's limbs
        are longer or shorter, and their markers are placed elsewhere.
    lag_source : LagSource, optional
        Needed where `train` has lagged positions.
    models : sequence of GPModel, optional
        The models that are fitted to this problem, where they are not those of all problems.
    simulated_gaps : tuple of SimulatedGap
        Gaps in other recordings, which show what this problem is worth.
    """

    train: PoseSamples
    query: PoseSamples
    distance: NDArray[np.float64]
    spread: NDArray[np.float64]
    error_penalty: float = 1.0
    offset_variance: float = 0.0
    lag_source: LagSource | None = None
    models: Sequence[GPModel] | None = None
    simulated_gaps: tuple[SimulatedGap, ...] = ()

    def query_batch(self, chosen: slice) -> PoseSamples:
        """Return some of the query poses, with lagged positions if the training poses have them."""
        queries = self.query.subset(chosen)
        return queries if self.lag_source is None else self.lag_source(queries)

    def supports(self, model: GPModel) -> bool:
        """Whether the training poses have the features of a model."""
        lag = model.lag_feature
        return lag is None or lag.seconds in self.train.lagged

"""Gaussian-process regression with fixed hyper-parameters.

``GaussianProcess(kernel, noise_variance).fit(pairs, targets)`` gives a `FittedGP` with the usual
``predict``, and residuals of held-out samples in closed form. The mean function may hold explicit
basis functions with free coefficients, as in universal kriging.

References
----------
.. [RW06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
.. [D83] Dubrule, Cross validation of kriging in a unique neighborhood, Mathematical Geology 15,
   1983.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.kernels import Kernel, Pairs
from priorfill.gp.linalg import block_residuals, explained_variance, inverse_root, solve_blocks
from priorfill.runtime.option_checks import check_at_least

__all__ = ["FittedGP", "GaussianProcess"]

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class GaussianProcess:
    """A Gaussian process with a given covariance; see `fit`.

    Attributes
    ----------
    kernel : Kernel
        Its covariance function.
    noise_variance : float
        Variance of the noise of each sample, in the kernel's unit.

    Examples
    --------
    >>> import numpy as np
    >>> from priorfill.gp.kernels import Matern52, Pairs
    >>> t, y = np.array([0.0, 0.1, 0.3, 0.4]), np.array([[0.0], [1.0], [1.0], [0.0]])
    >>> fitted = GaussianProcess(Matern52(0.3), 1e-6).fit(Pairs.of_times(t, t), y)
    >>> mean, variance = fitted.predict(Pairs.of_times(np.array([0.2]), t))
    >>> mean.round(2), variance.round(4)
    (array([[1.45]]), array([0.0114]))
    """

    kernel: Kernel
    noise_variance: float

    def __post_init__(self) -> None:
        """Check the variance."""
        check_at_least(self, 0.0, "noise_variance")

    def fit(
        self,
        train: Pairs,
        targets: _Floats,
        basis: _Floats | None = None,
        noise_variance: _Floats | None = None,
    ) -> FittedGP:
        """Condition the process on samples [RW06]_ (Eq. 2.25, 2.26; with a basis Eq. 2.41, 2.42).

        Parameters
        ----------
        train : Pairs
            Of the samples with each other.
        targets : ndarray [shape=(samples, outputs)]
            The outputs are independent processes with the same kernel. With the identity matrix,
            predictions are the weights of the samples.
        basis : ndarray [shape=(samples, functions)], optional
            Explicit basis functions, whose coefficients are free (their prior is infinitely wide).
        noise_variance : ndarray [shape=(samples,)], optional
            Of each sample, instead of the same for all.

        Returns
        -------
        FittedGP
            Predicts the process at other points.

        Raises
        ------
        numpy.linalg.LinAlgError
            Where the covariance matrix is not positive definite, even with jitter.
        """
        covariance = self.kernel(train)
        noise = self.noise_variance if noise_variance is None else noise_variance
        diagonal = np.einsum("ii->i", covariance)  # a view
        diagonal += noise
        root = inverse_root(covariance)
        weights = root.T @ (root @ targets)
        if basis is None:
            return FittedGP(self.kernel, root, weights)
        whitened = root @ basis
        projected = root.T @ whitened  # inv(K) H
        coefficient_covariance = solve_blocks(
            (whitened.T @ whitened)[None], np.eye(basis.shape[1])[None]
        )[0]
        coefficients = coefficient_covariance @ (projected.T @ targets)
        residuals = targets - basis @ coefficients
        weights = weights - projected @ coefficients
        degrees = len(targets) - basis.shape[1]
        return FittedGP(
            self.kernel,
            root,
            weights,
            _FittedBasis(projected, coefficients, coefficient_covariance),
            (residuals * weights).sum(axis=0) / degrees,
        )


@dataclass(frozen=True, eq=False)
class _FittedBasis:
    """Free coefficients of explicit basis functions, H at the samples."""

    projected: _Floats  # (samples, functions), inv(K) H
    coefficients: _Floats  # (functions, outputs)
    covariance: _Floats  # (functions, functions), of the coefficients


@dataclass(frozen=True, eq=False)
class FittedGP:
    """A Gaussian process conditioned on samples.

    Attributes
    ----------
    kernel : Kernel
        Its covariance function.
    root : ndarray [shape=(samples, samples)]
        R, lower triangular, with R'R the inverse of the samples' covariance with noise; see
        `priorfill.gp.linalg.inverse_root`.
    weights : ndarray [shape=(samples, outputs)]
        The inverse covariance times the targets less their fitted basis functions.
    basis : _FittedBasis, optional
        The fitted basis functions.
    scale : ndarray [shape=(outputs,)], optional
        With basis functions: the factor of the covariance under which the targets are most
        likely, unbiased (restricted maximum likelihood).
    """

    kernel: Kernel
    root: _Floats
    weights: _Floats
    basis: _FittedBasis | None = None
    scale: _Floats | None = None

    def predict(
        self, cross: Pairs, basis: _Floats | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Predict the process, without noise, at other points.

        Parameters
        ----------
        cross : Pairs
            Of these points (first set) with the samples (second set).
        basis : ndarray [shape=(points, functions)], optional
            The basis functions at these points, if the process was fitted with some.

        Returns
        -------
        mean : ndarray [shape=(points, outputs)]
        variance : ndarray [shape=(points,)]
            In the kernel's unit, the same for all outputs; at least 0.
        """
        covariance = self.kernel(cross)
        mean = covariance @ self.weights
        variance = self.kernel.variance(cross) - explained_variance(self.root, covariance)
        if self.basis is not None:
            if basis is None:
                raise ValueError("this process was fitted with basis functions; give them here too")
            mean += basis @ self.basis.coefficients
            beyond = basis - covariance @ self.basis.projected
            variance += np.einsum("qa,ab,qb->q", beyond, self.basis.covariance, beyond)
        return mean, np.maximum(variance, 0.0)

    def leave_blocks_out(
        self, blocks: Sequence[NDArray[np.intp]]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Predict each block of samples from all others, in closed form.

        [RW06]_ Eq. (5.12), generalised to blocks and, with basis functions, to their free
        coefficients [D83]_: with G the inverse covariance, the residuals of block B are
        ``inv(G_BB) (G y)_B``, and their covariance is ``inv(G_BB)``.

        Parameters
        ----------
        blocks : sequence of ndarray of int
            Disjoint, each ascending.

        Returns
        -------
        residuals : ndarray [shape=(samples, outputs)]
            Targets minus predictions; NaN outside all blocks.
        variance : ndarray [shape=(samples,)]
            Of each residual, noise included, in the kernel's unit; NaN outside all blocks.
        """
        residuals = np.full_like(self.weights, np.nan)
        variance = np.full(len(self.weights), np.nan)
        samples = np.concatenate(blocks)
        residuals[samples], variance[samples] = self._left_out(blocks)
        return residuals, variance

    def leave_neighbours_out(
        self, points: NDArray[np.intp], neighbours: Sequence[NDArray[np.intp]]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Predict single samples, each without its neighbours, which may overlap.

        Parameters
        ----------
        points : ndarray of int [shape=(points,)]
            Which samples.
        neighbours : sequence of ndarray of int
            What is left out for each of them: itself and others.

        Returns
        -------
        residuals : ndarray [shape=(points, outputs)]
        variance : ndarray [shape=(points,)]
            As of `leave_blocks_out`.
        """
        residuals = np.empty((len(points), self.weights.shape[1]))
        variance = np.empty(len(points))
        for place, (point, block) in enumerate(zip(points, neighbours, strict=True)):
            left, spread = self._left_out([block])
            at = int(np.flatnonzero(block == point)[0])
            residuals[place], variance[place] = left[at], spread[at]
        return residuals, variance

    def _left_out(self, blocks: Sequence[NDArray[np.intp]]) -> tuple[_Floats, _Floats]:
        """Return residuals and variances of blocks, one block after the other."""
        basis = None
        if self.basis is not None:
            projected = self.basis.projected
            basis = (projected @ self.basis.covariance, projected)
        return block_residuals(self.root, self.weights, blocks, basis)

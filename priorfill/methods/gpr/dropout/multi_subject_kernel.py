"""Covariance of poses of several subjects (coregionalisation)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.kernels import (
    RBF,
    Constant,
    Kernel,
    Linear,
    On,
    Pairs,
    SameRecording,
    SameSubject,
)

__all__ = ["MultiSubjectKernel", "subject_pairs"]

BODY_SHAPE = "body shape"
"""Name of the space of body shapes in `Pairs`."""


@dataclass(frozen=True)
class MultiSubjectKernel(Kernel):
    """Covariance of poses of several subjects, some of them seen in the mirror image.

    The covariance of two poses with features f and f' is
    ``1 + k + b (offset_variance + movement_ratio k)`` with
    ``k = linear_variance f . f' + rbf_variance exp(-|f - f'|² / 2 length_scale²)``. The first two
    terms are common to all subjects. The last one is what a subject deviates by, and is correlated
    between donors by ``b = shape_share exp(-|d|² / 2 shape_scale²) + image_share [same subject]
    + rest [same subject and same side]``, where d is the difference of their body shapes
    (`MarkerCoupling.body_shape`) and the three shares sum to 1. This is the intrinsic
    coregionalisation model of several outputs [A12]_ (section 4.2.2) with b as its matrix.

    Attributes
    ----------
    linear_variance, rbf_variance : float
        Variances of the linear and of the squared-exponential part of k.
    length_scale : float
        Of the squared-exponential part, in units of the features.
    offset_variance : float
        Variance of a subject's constant deviation.
    movement_ratio : float
        Variance of a subject's deviation that depends on the pose, in units of k.
    shape_share, image_share : float
        Shares of the deviations common to subjects of the same shape, and to a subject and its
        mirror image.
    shape_scale : float
        mm; length scale of the difference of shapes.

    Examples
    --------
    >>> import numpy as np
    >>> kernel = MultiSubjectKernel(
    ...     linear_variance=1.0,
    ...     rbf_variance=0.0,
    ...     length_scale=1.0,
    ...     offset_variance=0.5,
    ...     movement_ratio=0.0,
    ...     shape_share=0.6,
    ...     image_share=0.1,
    ...     shape_scale=30.0,
    ... )
    >>> donors = np.array([0, 1])  # of the same shape, but different subjects
    >>> pairs = subject_pairs(np.zeros((2, 1)), donors, donors < 0, donors, donors)
    >>> kernel(pairs.with_features(np.zeros((2, 2)), np.zeros(2), np.zeros(2)))
    array([[1.5, 1.3],
           [1.3, 1.5]])

    See Also
    --------
    subject_pairs : The pairs of poses that it is evaluated on.

    References
    ----------
    .. [A12] Álvarez, Rosasco and Lawrence, Kernels for Vector-Valued Functions: A Review,
       Foundations and Trends in Machine Learning 4(3), 2012. https://doi.org/10.1561/2200000036
    """

    linear_variance: float
    rbf_variance: float
    length_scale: float
    offset_variance: float
    movement_ratio: float
    shape_share: float
    image_share: float
    shape_scale: float
    uses_features: ClassVar[bool] = True

    @property
    def composed(self) -> Kernel:
        """The kernel as an expression of simple ones."""
        pose = self.linear_variance * Linear() + self.rbf_variance * RBF(self.length_scale)
        subject = (
            self.shape_share * On(BODY_SHAPE, RBF(self.shape_scale))
            + self.image_share * SameSubject()
            + (1.0 - self.shape_share - self.image_share) * SameRecording()
        )
        deviation = self.offset_variance * Constant() + self.movement_ratio * pose
        return Constant() + pose + subject * deviation

    def evaluate(self, pairs: Pairs) -> NDArray[np.float64] | float:
        """See `Kernel.evaluate`."""
        return pairs.value(self.composed)

    def variance(self, pairs: Pairs) -> NDArray[np.float64] | float:
        """Return the variance of each pose of the first set [shape=(a,)]."""
        return self.composed.variance(pairs)


def subject_pairs(
    shapes: NDArray[np.float64],
    subject: NDArray[np.intp],
    mirrored: NDArray[np.bool_],
    one: NDArray[np.intp],
    other: NDArray[np.intp],
) -> Pairs:
    """Return pairs of poses, without their features, for a `MultiSubjectKernel`.

    Parameters
    ----------
    shapes : ndarray [shape=(donors, pairs of markers), mm]
        Body shapes.
    subject : ndarray of int [shape=(donors,)]
        Number of each donor's subject.
    mirrored : ndarray of bool [shape=(donors,)]
        Whether a donor is the mirror image of its subject.
    one, other : ndarray of int [shapes=(a,), (b,)]
        Donor of each pose of the two sets.
    """
    at = np.ix_(one, other)
    norms = (shapes**2).sum(axis=1)
    same_subject = subject[:, None] == subject
    same_side = same_subject & (mirrored[:, None] == mirrored)
    pairs = Pairs((len(one), len(other)))
    shape_pairs = pairs.with_features((shapes @ shapes.T)[at], norms[one], norms[other])
    return Pairs(
        pairs.shape,
        same_subject=same_subject[at],
        same_recording=same_side[at],
        spaces={BODY_SHAPE: shape_pairs},
    )

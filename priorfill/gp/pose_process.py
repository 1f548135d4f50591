"""Gaussian processes from poses to the coordinates of missing markers."""

from __future__ import annotations

from dataclasses import dataclass, field

from priorfill.gp.kernels import Kernel, SubjectCorrelation
from priorfill.runtime.option_checks import check_at_least

__all__ = ["PoseProcess"]


@dataclass(frozen=True)
class PoseProcess:
    """A Gaussian process of poses.

    The covariance of poses x and y is
    ``(1 + linear x . y + rbf exp(-|x - y|² / 2 length_scale²)) factor + of_time``.

    Attributes
    ----------
    linear : float
        Variance of the linear kernel.
    rbf : float
        Variance of the squared exponential kernel.
    length_scale : float
        In units of the features.
    of_time : Kernel
        Covariance of what the visible markers do not explain: it joins the prediction to the
        measured samples at the gap's edges. It must not depend on features, nor must `factor`.
    noise_variance : float
        Variance of the noise of each sample, in the kernel's unit.
    factor : Kernel
        Of the covariance of poses, that of their subjects by default. Its variance is 1.

    Examples
    --------
    >>> from priorfill.gp.kernels import Exponential
    >>> PoseProcess(linear=1.0, of_time=0.1 * Exponential(0.1), noise_variance=1e-4).rbf
    0.0
    """

    linear: float
    of_time: Kernel
    noise_variance: float
    rbf: float = 0.0
    length_scale: float = 1.0
    factor: Kernel = field(default_factory=SubjectCorrelation)

    def __post_init__(self) -> None:
        """Check the variances and kernels."""
        check_at_least(self, 0.0, "linear", "rbf", "noise_variance")
        check_at_least(self, 1e-6, "length_scale")
        for name in ("of_time", "factor"):
            if getattr(self, name).uses_features:
                raise ValueError(f"{name} must not depend on features")

"""Covariance functions (kernels) of Gaussian processes, composed with ``+`` and ``*``.

A kernel is an expression, for example ``Constant() + 3.0 * Linear() + RBF(0.6)``. It is frozen
and hashable, so it can be a default of an options class and a key of a cache. It is evaluated on
`Pairs`, which hold what any kernel needs of the points of two sets: inner products of their
features, time lags, and which of them share a recording or a subject. `Pairs` remember the matrix
of every simple kernel, and of every part of an expression that does not depend on the features: a
hundred kernels that share a length scale compute its exponentials once.

The noise of measurements is no kernel but a parameter of `priorfill.gp.process.GaussianProcess`.

Examples
--------
>>> import numpy as np
>>> from priorfill.gp.kernels import RBF, Constant, Linear, Pairs
>>> kernel = Constant() + 3.0 * Linear() + RBF(length_scale=0.6)
>>> x = np.array([[0.0], [0.6]])
>>> kernel(Pairs.of_features(x, x)).round(3)
array([[2.   , 1.607],
       [1.607, 3.08 ]])

References
----------
.. [RW06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.linalg import squared_distances
from priorfill.runtime.elementary import exp
from priorfill.runtime.option_checks import check_at_least

__all__ = [
    "RBF",
    "Constant",
    "Exponential",
    "Forgetting",
    "Kernel",
    "Linear",
    "Matern32",
    "Matern52",
    "Matern72",
    "On",
    "Pairs",
    "Product",
    "SameRecording",
    "SameSubject",
    "Scaled",
    "SubjectCorrelation",
    "Sum",
]

MAX_SCALED_LAG = 700.0
"""Upper limit of scaled lags: exp(-r) is 0 beyond it, and infinity times 0 would be NaN."""

_Value = NDArray[np.float64] | float


class Kernel(ABC):
    """A covariance function.

    ``kernel(pairs)`` is its matrix, ``kernel.variance(pairs)`` the variance of each point.
    """

    uses_features: ClassVar[bool] = False
    """Whether it depends on the points' features, and not on their times or labels alone."""

    def __call__(self, pairs: Pairs) -> NDArray[np.float64]:
        """Return the covariance of each pair of points [shape=(a, b)], a new array."""
        value = pairs.value(self)
        if isinstance(value, float):
            return np.full(pairs.shape, value)
        return value if value.flags.writeable else value.copy()

    @abstractmethod
    def evaluate(self, pairs: Pairs) -> NDArray[np.float64] | float:
        """Compute the matrix; a number where all its elements are the same."""

    def variance(self, pairs: Pairs) -> NDArray[np.float64] | float:
        """Return the covariance of each point of the first set with itself [shape=(a,)].

        A number where it is the same for all of them; 1, unless a kernel's own docstring differs.
        """
        return 1.0

    def __add__(self, other: Kernel) -> Sum:
        return Sum(self, other)

    def __mul__(self, other: Kernel | float) -> Kernel:
        return Product(self, other) if isinstance(other, Kernel) else Scaled(float(other), self)

    def __rmul__(self, factor: float) -> Scaled:
        return Scaled(float(factor), self)


@dataclass(frozen=True)
class _Combination(Kernel):
    """Two kernels in one expression."""

    left: Kernel
    right: Kernel

    @cached_property
    def uses_features(self) -> bool:  # type: ignore[override]
        """Whether one of them does."""
        return self.left.uses_features or self.right.uses_features


@dataclass(frozen=True)
class Sum(_Combination):
    """The sum of two kernels, ``k1(x, y) + k2(x, y)`` [RW06]_ (section 4.2.4)."""

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        one, other = _fresh_first(pairs.value(self.left), pairs.value(self.right))
        if isinstance(one, float) or not one.flags.writeable:
            return one + other
        one += other
        return one

    def variance(self, pairs: Pairs) -> _Value:
        """Return the sum of their variances."""
        return self.left.variance(pairs) + self.right.variance(pairs)


@dataclass(frozen=True)
class Product(_Combination):
    """The product of two kernels, ``k1(x, y) k2(x, y)`` [RW06]_ (section 4.2.4)."""

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        one, other = _fresh_first(pairs.value(self.left), pairs.value(self.right))
        if isinstance(other, float) and other == 1.0:
            return one
        if isinstance(one, float) or not one.flags.writeable:
            return one * other
        one *= other
        return one

    def variance(self, pairs: Pairs) -> _Value:
        """Return the product of their variances."""
        return self.left.variance(pairs) * self.right.variance(pairs)


@dataclass(frozen=True)
class Scaled(Kernel):
    """A kernel times a variance, ``factor k(x, y)``.

    Attributes
    ----------
    factor : float
        At least 0.
    kernel : Kernel
        What is scaled.
    """

    factor: float
    kernel: Kernel

    @cached_property
    def uses_features(self) -> bool:  # type: ignore[override]
        """Whether the kernel does."""
        return self.kernel.uses_features

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        value = pairs.value(self.kernel)
        return value if self.factor == 1.0 else self.factor * value

    def variance(self, pairs: Pairs) -> _Value:
        """Return the scaled variance."""
        return self.factor * self.kernel.variance(pairs)


@dataclass(frozen=True)
class Constant(Kernel):
    """A constant covariance, ``k(x, y) = 1``: an unknown mean of unit variance."""

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        return 1.0


@dataclass(frozen=True)
class Linear(Kernel):
    """Bayesian linear regression, ``k(x, y) = x . y`` [RW06]_ (Eq. 2.12)."""

    uses_features: ClassVar[bool] = True

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        return pairs.product

    def variance(self, pairs: Pairs) -> _Value:
        """Return the squared norm of each point's features."""
        return pairs.squared_norms[0]


@dataclass(frozen=True)
class RBF(Kernel):
    """Squared exponential, ``k(x, y) = exp(-|x - y|² / 2 length_scale²)`` [RW06]_ (Eq. 4.9).

    Attributes
    ----------
    length_scale : float
        In units of the features.
    """

    length_scale: float
    uses_features: ClassVar[bool] = True

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        return exp(pairs.squared_distance * (-0.5 / self.length_scale**2))


@dataclass(frozen=True)
class _TimeKernel(Kernel):
    """A covariance that depends on the time between two points, on a time scale (s)."""

    time_scale: float

    def __post_init__(self) -> None:
        """Check the time scale."""
        check_at_least(self, 1e-6, "time_scale")


@dataclass(frozen=True)
class Exponential(_TimeKernel):
    """Ornstein-Uhlenbeck process, ``k(t) = exp(-|t| / time_scale)`` [RW06]_ (Eq. 4.14, ν = 1/2).

    Its samples are continuous, but have no velocity.

    Attributes
    ----------
    time_scale : float
        s.
    """

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        return exp(-pairs.lag / self.time_scale)


@dataclass(frozen=True)
class Matern32(_TimeKernel):
    """Matérn covariance of smoothness 3/2 over time [RW06]_ (Eq. 4.17): velocities are continuous.

    ``k(t) = (1 + r) exp(-r)``, ``r = sqrt(3) |t| / time_scale``.

    Attributes
    ----------
    time_scale : float
        s.
    """

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        r = _scaled_lag(pairs, 3.0, self.time_scale)
        return (1.0 + r) * exp(-r)


@dataclass(frozen=True)
class Matern52(_TimeKernel):
    """Matérn covariance of smoothness 5/2 over time [RW06]_ (Eq. 4.17).

    ``k(t) = (1 + r + r² / 3) exp(-r)``, ``r = sqrt(5) |t| / time_scale``: accelerations are
    continuous.

    Attributes
    ----------
    time_scale : float
        s.
    """

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        r = _scaled_lag(pairs, 5.0, self.time_scale)
        return (1.0 + r + r**2 / 3.0) * exp(-r)


@dataclass(frozen=True)
class Matern72(_TimeKernel):
    """Matérn covariance of smoothness 7/2 over time [RW06]_ (Eq. 4.16, p = 3).

    ``k(t) = (1 + r + 2 r² / 5 + r³ / 15) exp(-r)``, ``r = sqrt(7) |t| / time_scale``: the third
    derivatives are continuous.

    Attributes
    ----------
    time_scale : float
        s.
    """

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        r = _scaled_lag(pairs, 7.0, self.time_scale)
        return (1.0 + r + 0.4 * r**2 + r * r**2 / 15.0) * exp(-r)


@dataclass(frozen=True)
class Forgetting(Kernel):
    """Correlation that falls with time to a limit, ``k(t) = limit + (1 - limit) exp(-|t| / time)``.

    A factor for kernels of poses: markers slip and movements change. Points of different
    recordings are correlated by ``limit``.

    Attributes
    ----------
    time : float
        s.
    limit : float
        Correlation of points far apart in time.
    """

    time: float
    limit: float = 0.5

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        return self.limit + (1.0 - self.limit) * exp(-pairs.lag / self.time)


@dataclass(frozen=True)
class SubjectCorrelation(Kernel):
    """Correlation of the points' subjects, `Pairs.correlation`; 1 where none is given."""

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        return 1.0 if pairs.correlation is None else pairs.correlation


@dataclass(frozen=True)
class SameSubject(Kernel):
    """An offset of each subject: 1 for two points of one subject, else 0."""

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        return _indicator(pairs.same_subject)


@dataclass(frozen=True)
class SameRecording(Kernel):
    """An offset of each recording: 1 for two points of one recording, else 0."""

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        return _indicator(pairs.same_recording)


@dataclass(frozen=True)
class On(Kernel):
    """A kernel of another group of features than the main one.

    Attributes
    ----------
    space : str
        Which group; a key of `Pairs.spaces`.
    kernel : Kernel
        Evaluated there.
    """

    space: str
    kernel: Kernel

    def evaluate(self, pairs: Pairs) -> _Value:
        """See `Kernel.evaluate`."""
        return pairs.spaces[self.space].value(self.kernel)

    def variance(self, pairs: Pairs) -> _Value:
        """Return the kernel's variance in its space."""
        return self.kernel.variance(pairs.spaces[self.space])


@dataclass(frozen=True, eq=False)
class Pairs:
    """What kernels need of each pair of points, one of a set of a and one of a set of b.

    Only what the evaluated kernels use must be given.

    Attributes
    ----------
    shape : tuple of int
        (a, b).
    inner_products : ndarray [shape=(a, b)], optional
        Of the points' features.
    norms : tuple of ndarray [shapes=(a,), (b,)], optional
        Squared norms of the points' features.
    time_lags : ndarray [shape=(a, b), s], optional
        At least 0; infinite between points of different recordings.
    same_subject, same_recording : ndarray of bool [shape=(a, b)], optional
        Whether two points share it. By default all points do.
    correlation : ndarray [shape=(a, b)], optional
        Correlation of the points' subjects; 1 by default.
    spaces : mapping of str to Pairs
        The same pairs of points with other features; see `On`.
    """

    shape: tuple[int, int]
    inner_products: NDArray[np.float64] | None = None
    norms: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    time_lags: NDArray[np.float64] | None = None
    same_subject: NDArray[np.bool_] | None = None
    same_recording: NDArray[np.bool_] | None = None
    correlation: NDArray[np.float64] | None = None
    spaces: Mapping[str, Pairs] = field(default_factory=dict)
    _distances: list[NDArray[np.float64]] = field(default_factory=list)
    _of_features: dict[Kernel, NDArray[np.float64]] = field(default_factory=dict)
    _of_time: dict[Kernel, NDArray[np.float64]] = field(default_factory=dict)

    @classmethod
    def of_features(cls, one: NDArray[np.float64], other: NDArray[np.float64]) -> Pairs:
        """Return pairs of points with features [shapes=(a, features), (b, features)]."""
        product = one @ other.T
        return cls(product.shape).with_features(
            product, (one**2).sum(axis=1), (other**2).sum(axis=1)
        )

    @classmethod
    def of_times(cls, one: NDArray[np.float64], other: NDArray[np.float64]) -> Pairs:
        """Return pairs of times of one recording [shapes=(a,), (b,), s]."""
        lag = np.abs(one[:, None] - other)
        return cls((len(one), len(other)), time_lags=lag)

    def with_features(
        self,
        product: NDArray[np.float64],
        norms_one: NDArray[np.float64],
        norms_other: NDArray[np.float64],
    ) -> Pairs:
        """Return the same pairs with other features; kernels without features stay computed.

        Parameters
        ----------
        product : ndarray [shape=(a, b)]
            Inner products.
        norms_one, norms_other : ndarray [shapes=(a,), (b,)]
            Squared norms.
        """
        return replace(
            self,
            inner_products=product,
            norms=(norms_one, norms_other),
            _distances=[],
            _of_features={},
        )

    def value(self, kernel: Kernel) -> NDArray[np.float64] | float:
        """Return a kernel's matrix, read-only where it is remembered; see `Kernel.evaluate`."""
        simple = type(kernel) is RBF  # isinstance with an abstract class is slow
        if kernel.uses_features and not simple:
            return kernel.evaluate(self)
        known = self._of_features if simple else self._of_time
        found = known.get(kernel)
        if found is None:
            value = kernel.evaluate(self)
            if isinstance(value, float):
                return value
            found = value.view()
            found.flags.writeable = False
            known[kernel] = found
        return found

    @property
    def product(self) -> NDArray[np.float64]:
        """Inner products of the points' features [shape=(a, b)], read-only."""
        if self.inner_products is None:
            raise ValueError("these pairs have no features")
        product = self.inner_products.view()
        product.flags.writeable = False
        return product

    @property
    def squared_norms(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Squared norms of the points' features [shapes=(a,), (b,)]."""
        if self.norms is None:
            raise ValueError("these pairs have no features")
        return self.norms

    @property
    def squared_distance(self) -> NDArray[np.float64]:
        """Squared distances of the points' features [shape=(a, b)]."""
        if not self._distances:
            self._distances.append(squared_distances(self.product, *self.squared_norms))
        return self._distances[0]

    @property
    def lag(self) -> NDArray[np.float64]:
        """Time between the points [shape=(a, b), s]."""
        if self.time_lags is None:
            raise ValueError("these pairs have no times")
        return self.time_lags


def _fresh_first(one: _Value, other: _Value) -> tuple[_Value, _Value]:
    """Return two operands, first one that may be overwritten, if there is one; numbers last."""
    if isinstance(one, float) or (
        not one.flags.writeable and not isinstance(other, float) and other.flags.writeable
    ):
        return other, one
    return one, other


def _scaled_lag(pairs: Pairs, squared_factor: float, time_scale: float) -> NDArray[np.float64]:
    """Return sqrt(2 ν) |t| / time scale, at most `MAX_SCALED_LAG`."""
    r: NDArray[np.float64] = np.minimum(
        np.sqrt(squared_factor) / time_scale * pairs.lag, MAX_SCALED_LAG
    )
    return r


def _indicator(mask: NDArray[np.bool_] | None) -> _Value:
    """Return a mask as numbers; 1 where there is none."""
    return 1.0 if mask is None else mask.astype(np.float64)

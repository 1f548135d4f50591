"""Elementary functions that give the same bits on every system.

The C libraries of Linux, Windows and macOS, and the vectorised loops of NumPy, round them
differently in the last bit. The functions here consist of additions, multiplications, divisions and
square roots, which IEEE 754 rounds in one way. With them, and with those routines of linear
algebra whose builds agree (`priorfill.gp.linalg.solve_blocks`), a fill writes the same file on
every system.

The polynomials are those of Sun's fdlibm (e_exp.c, e_log.c, k_sin.c), with an error below 1 unit in
the last place.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["bessel_i0", "exp", "hypot", "log", "power", "sin"]

_Floats = NDArray[np.float64]

LOG_COEFFICIENTS = (
    1.479819860511658591e-01,
    1.531383769920937332e-01,
    1.818357216161805012e-01,
    2.222219843214978396e-01,
    2.857142874366239149e-01,
    3.999999999940941908e-01,
    6.666666666666735130e-01,
)
"""Of (ln(1 + f) - f + ...) / s² in s = f / (2 + f), the highest power first."""

SIN_COEFFICIENTS = (
    1.58969099521155010221e-10,
    -2.50507602534068634195e-08,
    2.75573137070700676789e-06,
    -1.98412698298579493134e-04,
    8.33333333332248946124e-03,
    -1.66666666666666324348e-01,
)
"""Of (sin x - x) / x³ in x² for \\|x\\| <= π/4, the highest power first."""

HALVINGS = 2
"""Times that an angle up to π is halved before its sine is computed."""

MAX_FACTORS = 64
"""Largest power that is computed by repeated multiplication; larger ones would take long."""


def exp(values: ArrayLike) -> _Floats:
    """Return e to the power of each value.

    Parameters
    ----------
    values : array_like

    Returns
    -------
    ndarray [shape as given]
        0 for -708 and less, where the result would lose precision, and infinity above 709.

    Examples
    --------
    >>> exp([0.0, -1.0, -1000.0]).round(6).tolist()
    [1.0, 0.367879, 0.0]
    """
    from priorfill.runtime.elementary_kernels import exponentials  # numba is slow to import

    given = np.asarray(values, dtype=np.float64)
    result = np.empty(given.shape)
    exponentials(np.ascontiguousarray(given).reshape(-1), result.reshape(-1))
    return result


def log(values: ArrayLike) -> _Floats:
    """Return the natural logarithm of each value.

    Parameters
    ----------
    values : array_like

    Returns
    -------
    ndarray [shape as given]
        Minus infinity for 0, NaN below.

    Examples
    --------
    >>> log([1.0, 10.0]).round(6).tolist()
    [0.0, 2.302585]
    """
    from priorfill.runtime.elementary_kernels import LN2_HIGH, LN2_LOW  # numba is slow to import

    given = np.asarray(values, dtype=np.float64)
    usual = (given > 0.0) & (given < math.inf)
    mantissa, exponent = np.frexp(np.where(usual, given, 1.0))
    small = mantissa < math.sqrt(0.5)
    exponent = exponent - small
    f = np.where(small, 2.0 * mantissa, mantissa) - 1.0
    s = f / (2.0 + f)
    half = 0.5 * f * f
    series = _polynomial(LOG_COEFFICIENTS, s * s) * (s * s)
    low = s * (half + series) + exponent * LN2_LOW
    result = exponent * LN2_HIGH - ((half - low) - f)
    limit = np.where(given == 0.0, -math.inf, np.where(given == math.inf, math.inf, math.nan))
    return np.asarray(np.where(usual, result, limit))


def hypot(one: ArrayLike, other: ArrayLike) -> _Floats:
    """Return the square root of the sum of two squares, which must not exceed 1e300.

    Parameters
    ----------
    one, other : array_like

    Returns
    -------
    ndarray [shape as given]

    Examples
    --------
    >>> float(hypot(3.0, 4.0))
    5.0
    """
    return np.asarray(np.sqrt(np.square(one) + np.square(other), dtype=np.float64))


def power(values: ArrayLike, exponent: float) -> _Floats:
    """Return a power of each value.

    Parameters
    ----------
    values : array_like
        At least 0 and finite.
    exponent : float
        Up to `MAX_FACTORS`, its integer part is computed by repeated multiplication; the rest from
        the logarithm. May be infinite.

    Returns
    -------
    ndarray [shape as given]
        Of 0, 0 for positive exponents and infinity for negative ones.

    Examples
    --------
    >>> power([4.0, 0.0], 1.5).tolist()
    [8.0, 0.0]
    """
    base = np.asarray(values, dtype=np.float64)
    if math.isinf(exponent) and exponent > 0:
        return np.where(base == 1.0, 1.0, np.where(base < 1.0, 0.0, math.inf))
    if exponent < 0:
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / power(base, -exponent))
    result = np.ones(base.shape)
    factors = int(exponent) if exponent <= MAX_FACTORS else 0
    for _ in range(factors):
        result = result * base
    rest = exponent - factors
    if rest == 0.5:
        result = result * np.sqrt(base)
    elif rest > 0.0:
        positive = base > 0.0
        with np.errstate(over="ignore"):  # infinity, as elsewhere
            logarithm = rest * log(np.where(positive, base, 1.0))
        result = result * np.where(positive, exp(logarithm), 0.0)
    return result


def sin(values: ArrayLike) -> _Floats:
    """Return the sine of each angle.

    Parameters
    ----------
    values : array_like [rad]
        Their precision is absolute: 1e-16 times the largest.

    Returns
    -------
    ndarray [shape as given]

    Examples
    --------
    >>> sin([0.0, math.pi / 2]).round(12).tolist()
    [0.0, 1.0]
    """
    angle = np.asarray(values, dtype=np.float64)
    turns = np.rint(angle / (2.0 * math.pi))
    part = (angle - turns * (2.0 * math.pi)) / 2.0**HALVINGS
    square = part * part
    sine = part + part * square * _polynomial(SIN_COEFFICIENTS, square)
    cosine = np.sqrt(1.0 - sine * sine)  # of at most a quarter of a half turn: positive
    for _ in range(HALVINGS):
        sine, cosine = 2.0 * sine * cosine, 1.0 - 2.0 * sine * sine
    return np.asarray(sine)


def bessel_i0(values: ArrayLike) -> _Floats:
    """Return the modified Bessel function of the first kind and order 0, by its power series.

    Parameters
    ----------
    values : array_like
        At most about 30 in magnitude, as for windows of filters.

    Returns
    -------
    ndarray [shape as given]

    Examples
    --------
    >>> bessel_i0([0.0, 1.0]).round(6).tolist()
    [1.0, 1.266066]
    """
    quarter = np.asarray(values, dtype=np.float64) ** 2 / 4.0
    total = term = np.ones(quarter.shape)
    order = 0
    while (term > np.finfo(float).eps * total).any():
        order += 1
        term = term * quarter / order**2
        total = total + term
    return np.asarray(total)


def _polynomial(coefficients: tuple[float, ...], x: _Floats) -> _Floats:
    """Return a polynomial, from its coefficients with the highest power first."""
    result = np.full(x.shape, coefficients[0])
    for coefficient in coefficients[1:]:
        result = result * x + coefficient
    return result

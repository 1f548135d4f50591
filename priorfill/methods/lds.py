"""A linear dynamical system fitted by expectation maximisation: DynaMMo [LMPF09]_.

Hidden states z follow z_t = A z_(t-1) + w and are observed as x_t = C z_t + v, with Gaussian w and
v of covariance Q and R; the initial state is Gaussian too. The Kalman filter and smoother estimate
the states from all visible coordinates (E-step); A, C, Q, R and the initial state are
estimated from these (M-step). Both alternate until the likelihood converges. Missing coordinates
are C z.

Departures from the paper and from the authors' program:

* The model is fitted to visible coordinates only. DynaMMo first interpolates the gaps
  linearly, and treats what it filled as observations, which ties each gap to its initial values.
  (Here the likelihood of the visible coordinates never decreases; that of DynaMMo is of
  changing data.)
* R is diagonal and Q any covariance; in the program both are multiples of the identity by default.
  Variances have a lower bound.
* The fit starts from the principal components of the linearly interpolated clip and their
  regression from frame to frame; the program starts from random numbers.

References
----------
.. [LMPF09] L. Li, J. McCann, N. Pollard and C. Faloutsos, DynaMMo: Mining and Summarization of
   Coevolving Sequences with Missing Values, KDD 2009, doi 10.1145/1557019.1557078. The M-step is
   that of Ghahramani and Hinton, Parameter Estimation for Linear Dynamical Systems, CRG-TR-96-2,
   1996.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap
from priorfill.methods.task import Estimate, Progress, Task, no_progress
from priorfill.runtime.option_checks import check_at_least

__all__ = [
    "LdsModel",
    "LdsOptions",
    "Observations",
    "SmoothedStates",
    "fill",
    "fit",
    "initial_model",
    "smooth",
]

Array = NDArray[np.float64]

CONVERGED_CHANGE = 1e-9
"""Relative change of a covariance between frames below which it counts as converged."""

MIN_ALLOWED_SD = 1e-6
"""mm. Least `LdsOptions.min_sd` with which covariances can be inverted."""

MAX_EXCURSION = 1000.0
"""mm. How far a fill may be outside the range of the marker's measured positions: a limb may leave
this range, but by no more than its length."""

MAX_STATE = 1e100
"""Hidden states beyond this have diverged: sums of their squares would overflow in the M-step."""

DIVERGED = (
    "the fitted system diverges by more than a metre from the marker's measured range; use auto"
)
NEVER_VISIBLE = "it is never visible; use a method that learns from other recordings"


@dataclass(frozen=True)
class LdsOptions:
    """Options of ``lds``.

    Attributes
    ----------
    hidden_dimensions : int
        Dimension of the hidden state; Gløersen and Federolf 2016 compare with 10.
    max_iterations : int
        Maximum number of EM iterations; 10 in DynaMMo, from random numbers. More than 20 do not
        improve fills of treadmill walking (WalkL of Gløersen and Federolf 2016).
    tolerance : float
        Relative increase of the log-likelihood below which the fit ends; 1e-5 in DynaMMo.
    min_sd : float
        mm. Lower bound of the standard deviations of states and observations; cameras have a noise
        of some tenths of a millimetre.

    Raises
    ------
    OptionError
        Where a value is below its minimum.
    """

    hidden_dimensions: int = 10
    max_iterations: int = 20
    tolerance: float = 1e-5
    min_sd: float = 0.01

    def __post_init__(self) -> None:
        check_at_least(self, 1, "hidden_dimensions")
        check_at_least(self, 0, "max_iterations", "tolerance")
        check_at_least(self, MIN_ALLOWED_SD, "min_sd")


@dataclass(frozen=True, eq=False)
class LdsModel:
    """A linear dynamical system.

    Attributes
    ----------
    transition : ndarray [shape=(k, k)]
        A.
    emission : ndarray [shape=(d, k)]
        C.
    process : ndarray [shape=(k, k), mm²]
        Q.
    noise : ndarray [shape=(d,), mm²]
        The diagonal of R.
    start : ndarray [shape=(k,)]
        Mean of the initial state.
    start_covariance : ndarray [shape=(k, k), mm²]
        Its covariance.
    """

    transition: Array
    emission: Array
    process: Array
    noise: Array
    start: Array
    start_covariance: Array


class Observations:
    """The visible coordinates, arranged for the filter and the fit.

    Parameters
    ----------
    observed : ndarray [shape=(frames, d), mm]
        Centred; NaN where missing.

    Attributes
    ----------
    values : ndarray [shape=(frames, d), mm]
        Zero where missing.
    patterns : ndarray of bool [shape=(patterns, d)]
        The distinct sets of coordinates that are visible in a frame.
    which : ndarray of int [shape=(frames,)]
        The pattern of each frame.
    counts : ndarray of int [shape=(d,)]
        Number of frames in which each coordinate is visible.
    squares : ndarray [shape=(d,), mm²]
        Sum of the squares of each coordinate.
    """

    def __init__(self, observed: Array) -> None:
        seen = ~np.isnan(observed)
        self.values = np.where(seen, observed, 0.0)
        self.patterns, which = np.unique(seen, axis=0, return_inverse=True)
        self.which = which.ravel()
        self.counts = seen.sum(axis=0)
        self.squares = (self.values**2).sum(axis=0)


@dataclass(frozen=True, eq=False)
class SmoothedStates:
    """The hidden states, given all visible coordinates.

    Attributes
    ----------
    means : ndarray [shape=(frames, k)]
        Means of the states.
    first, last : ndarray [shape=(k, k)]
        Covariances of the first and the last state.
    covariances : ndarray [shape=(patterns, k, k)]
        Covariances of the states, summed over the frames of each pattern.
    lagged : ndarray [shape=(k, k)]
        Covariances of each state with the preceding one, summed over the frames.
    likelihood : float
        Log-likelihood of the visible coordinates.
    """

    means: Array
    first: Array
    last: Array
    covariances: Array
    lagged: Array
    likelihood: float


def _symmetric(matrix: Array) -> Array:
    """Return the symmetric part of a matrix, to remove rounding errors."""
    return 0.5 * (matrix + matrix.T)


def _floored(covariance: Array, min_variance: float) -> Array:
    """Return the most likely covariance whose variances have a lower bound."""
    values, vectors = np.linalg.eigh(_symmetric(covariance))
    return _symmetric((vectors * np.maximum(values, min_variance)) @ vectors.T)


def _updated(predicted: Array, information: Array) -> tuple[Array, float]:
    """Return (P^-1 + G)^-1 and log det(I + P G) of a covariance P and an information G.

    With P = L L' it is L (I + L' G L)^-1 L': symmetric and positive semidefinite, and the inverted
    matrix has no eigenvalue below 1.
    """
    root, _ = _factor(predicted, 0.0)
    factor, determinant = _factor(np.eye(len(root)) + root.T @ information @ root, 1.0)
    half = np.linalg.solve(factor, root.T)
    return half.T @ half, determinant


def _factor(matrix: Array, min_eigenvalue: float) -> tuple[Array, float]:
    """Return F with F F' = a symmetric matrix, and the logarithm of its determinant.

    F is the Cholesky factor. Where rounding has made the matrix indefinite, as it does where
    visible coordinates hardly vary, eigenvalues are raised to the least one that is possible.
    """
    try:
        factor = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(_symmetric(matrix))
        values = np.maximum(values, max(min_eigenvalue, np.finfo(float).tiny))
        return np.asarray(vectors * np.sqrt(values)), float(np.log(values).sum())
    return np.asarray(factor), 2.0 * float(np.log(np.diag(factor)).sum())


def _solved(matrix: Array, right: Array) -> Array:
    """Solve symmetric systems; of those that rounding has made singular, the shortest solution."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(matrix, hermitian=True) @ right)


def _converged(one: Array, other: Array) -> bool:
    return bool(abs(one - other).max() <= CONVERGED_CHANGE * abs(other).max())


class _Forward:
    """The Kalman filter in information form, which inverts k x k matrices only.

    In a run of frames with the same pattern the covariances converge; from then on a frame costs
    one matrix-vector product.
    """

    def __init__(self, model: LdsModel, observations: Observations) -> None:
        weighted = model.emission / model.noise[:, None]
        # sum of c c' / r over the coordinates of each pattern
        products = weighted[:, :, None] * model.emission[:, None]
        k = len(model.transition)
        flat = observations.patterns.astype(np.float64) @ products.reshape(-1, k * k)
        self._information = flat.reshape(-1, k, k)
        self._projected = observations.values @ weighted
        self._which = observations.which
        self._model = model
        self.predicted: list[Array] = []
        self.updated: list[Array] = []
        frames = len(observations.values)
        # index of each frame's covariances in these lists
        self.number = np.empty(frames, dtype=np.intp)
        self.means = np.empty((frames, k))
        constant = observations.patterns @ (np.log(2.0 * np.pi * model.noise))
        squares = (observations.values**2) @ (1.0 / model.noise)
        self._twice = float(constant[self._which].sum() + squares.sum())
        self._run()
        self.likelihood = -0.5 * self._twice

    def _run(self) -> None:
        a = self._model.transition
        mean, predicted = self._model.start, self._model.start_covariance
        determinant = 0.0
        converged = False
        for frame, pattern in enumerate(self._which):
            information = self._information[pattern]
            same = frame > 0 and pattern == self._which[frame - 1]
            if frame:
                mean = a @ mean
            if not (same and converged):
                if frame:
                    predicted = _symmetric(a @ self.updated[-1] @ a.T) + self._model.process
                converged = same and _converged(predicted, self.predicted[-1])
                if not converged:
                    updated, determinant = _updated(predicted, information)
                    self.predicted.append(predicted)
                    self.updated.append(updated)
            self.number[frame] = len(self.updated) - 1
            projected = self._projected[frame]
            innovation = projected - information @ mean
            correction = self.updated[-1] @ innovation
            # e' S^-1 e of the innovation e; the squares of x are already in the sum
            expected = float(mean @ (projected + innovation))
            self._twice += determinant - expected - float(innovation @ correction)
            mean = mean + correction
            self.means[frame] = mean


def smooth(model: LdsModel, observations: Observations) -> SmoothedStates:
    """Return the hidden states by the Kalman filter and the Rauch-Tung-Striebel smoother."""
    forward = _Forward(model, observations)
    a = model.transition
    identity = np.eye(len(a))
    means = forward.means.copy()
    covariance = forward.updated[forward.number[-1]]
    last = covariance
    sums = np.zeros((len(observations.patterns), *a.shape))
    sums[observations.which[-1]] += covariance
    lagged = np.zeros_like(a)
    step: tuple[int, int] | None = None
    converged = False
    back: Array
    base: Array
    rest: Array
    for frame in range(len(means) - 2, -1, -1):
        here = (int(forward.number[frame]), int(forward.number[frame + 1]))
        if here != step:
            step, converged = here, False
            updated = forward.updated[here[0]]
            back = _solved(forward.predicted[here[1]], a @ updated).T
            rest = identity - back @ a
            # Joseph form: stays positive semidefinite despite rounding
            base = rest @ updated @ rest.T + back @ model.process @ back.T
        lagged += covariance @ back.T
        if not converged:
            before = covariance
            covariance = _symmetric(base + back @ covariance @ back.T)
            converged = _converged(covariance, before)
        sums[observations.which[frame]] += covariance
        means[frame] = rest @ forward.means[frame] + back @ means[frame + 1]
    return SmoothedStates(means, covariance, last, sums, lagged, forward.likelihood)


def _maximise(
    smoothed: SmoothedStates, observations: Observations, min_variance: float
) -> LdsModel:
    """Return the model with the highest expected likelihood (M-step)."""
    means, values = smoothed.means, observations.values
    frames, k = means.shape
    total = smoothed.covariances.sum(axis=0)
    start_covariance = _floored(smoothed.first, min_variance)
    transition: Array = np.eye(k)
    process: Array = np.eye(k) * min_variance
    if frames > 1:
        before = means[:-1].T @ means[:-1] + total - smoothed.last
        after = means[1:].T @ means[1:] + total - smoothed.first
        lagged = means[1:].T @ means[:-1] + smoothed.lagged
        transition = _solved(before, lagged.T).T
        mixed = transition @ lagged.T
        spread = after - mixed - mixed.T + transition @ before @ transition.T
        process = _floored(spread / (frames - 1), min_variance)
    # sum of z z' over the frames in which each coordinate is visible
    outer = smoothed.covariances.copy()
    order = np.argsort(observations.which, kind="stable")
    edges = np.searchsorted(observations.which[order], np.arange(len(outer) + 1))
    for number in range(len(outer)):
        some = means[order[edges[number] : edges[number + 1]]]
        outer[number] += some.T @ some
    seen = observations.patterns.T.astype(np.float64) @ outer.reshape(len(outer), -1)
    squares = seen.reshape(-1, k, k)
    products = values.T @ means
    emission: Array = _solved(squares, products[..., None])[..., 0]
    fitted = (emission * products).sum(axis=1)
    quadratic = np.einsum("di,dij,dj->d", emission, squares, emission)
    variances = (observations.squares - 2.0 * fitted + quadratic) / observations.counts
    noise = np.maximum(variances, min_variance)
    return LdsModel(transition, emission, process, noise, means[0].copy(), start_covariance)


def initial_model(observed: Array, hidden: int, min_variance: float) -> LdsModel:
    """Return the initial model: principal components of the interpolated clip.

    Parameters
    ----------
    observed : ndarray [shape=(frames, d), mm]
        Centred; NaN where missing.
    hidden : int
        Maximum dimension of the hidden state.
    min_variance : float
        Lower bound of variances (mm²).

    Returns
    -------
    LdsModel
        Its transition matrix is the regression of each frame's components on the preceding ones.
    """
    interpolated = observed.copy()
    frames = np.arange(len(observed))
    for column in interpolated.T:
        seen = ~np.isnan(column)
        column[~seen] = np.interp(frames[~seen], frames[seen], column[seen])
    k = max(1, min(hidden, *interpolated.shape))
    _, _, vectors = np.linalg.svd(interpolated, full_matrices=False)
    emission = vectors[:k].T
    states = interpolated @ emission
    noise = np.maximum((interpolated - states @ emission.T).var(axis=0), min_variance)
    transition, process = np.eye(k), np.eye(k) * min_variance
    if len(states) > 1:
        transition = np.linalg.lstsq(states[:-1], states[1:], rcond=None)[0].T
        error = states[1:] - states[:-1] @ transition.T
        process = _floored(error.T @ error / len(error), min_variance)
    return LdsModel(transition, emission, process, noise, states[0].copy(), process.copy())


def fit(
    observed: Array, options: LdsOptions, report: Callable[[float], None] | None = None
) -> tuple[LdsModel, SmoothedStates]:
    """Fit a linear dynamical system to the visible coordinates.

    Parameters
    ----------
    observed : ndarray [shape=(frames, d), mm]
        Centred; NaN where missing. Each column has a visible sample.
    options : LdsOptions
        Dimension of the state, and when the fit ends.
    report : callable, optional
        Called with the log-likelihood of each iteration.

    Returns
    -------
    LdsModel
        The most likely model.
    SmoothedStates
        Its hidden states.

    See Also
    --------
    initial_model : Where the fit starts.
    smooth : The E-step.
    """
    observations = Observations(observed)
    min_variance = options.min_sd**2
    model = initial_model(observed, options.hidden_dimensions, min_variance)
    smoothed = _smoothed(model, observations)
    for _ in range(options.max_iterations):
        if report is not None:
            report(smoothed.likelihood)
        if not np.abs(smoothed.means).max() < MAX_STATE:
            break
        better = _maximise(smoothed, observations, min_variance)
        again = _smoothed(better, observations)
        gain = again.likelihood - smoothed.likelihood
        if not gain > 0.0:
            break
        model, smoothed = better, again
        if gain <= options.tolerance * abs(smoothed.likelihood):
            break
    return model, smoothed


def _smoothed(model: LdsModel, observations: Observations) -> SmoothedStates:
    """Return the hidden states; those of an unstable system may be infinite or NaN."""
    with np.errstate(over="ignore", invalid="ignore"):
        return smooth(model, observations)


def fill(
    task: Task, progress: Progress = no_progress, options: LdsOptions | None = None
) -> Estimate:
    """Fill gaps by a linear dynamical system fitted to the clip.

    Parameters
    ----------
    task : Task
        The clip; its takes are not used.
    progress : callable
        Called with the number of samples done since the last call.
    options : LdsOptions, optional
        The defaults if not given.

    Returns
    -------
    Estimate
        Markers that are never visible stay missing, and so do samples predicted more than
        `MAX_EXCURSION` outside the marker's measured range: an unstable system diverges in a long
        gap. Errors are not predicted.

    See Also
    --------
    fit : Fits the system.
    """
    options = options or LdsOptions()
    positions = task.positions.copy()
    if task.groups and task.valid.any():
        seen = task.valid.any(axis=0)
        observed = positions[:, seen].reshape(len(positions), -1)
        middle = np.nanmean(observed, axis=0)
        step = task.samples / max(options.max_iterations, 1)
        model, smoothed = fit(observed - middle, options, lambda _: progress(step))
        with np.errstate(over="ignore", invalid="ignore"):
            found = smoothed.means @ model.emission.T + middle
        found = found.reshape(len(positions), -1, 3)
        low, high = (limit(positions[:, seen], axis=0) for limit in (np.nanmin, np.nanmax))
        inside = (found >= low - MAX_EXCURSION) & (found <= high + MAX_EXCURSION)
        found[~inside.all(axis=2)] = np.nan
        positions[:, seen] = found

    def reason(gap: Gap) -> str:
        return DIVERGED if task.valid[:, gap.marker].any() else NEVER_VISIBLE

    return Estimate.without_errors(task, positions, "a linear dynamical system of the clip", reason)

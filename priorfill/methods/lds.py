"""A linear dynamical system learnt by expectation maximisation: DynaMMo [LMPF09]_.

Hidden numbers z move by z_t = A z_(t-1) + w and show as x_t = C z_t + v, with Gaussian w and v, of
covariance Q and R; the first is Gaussian too. Kalman filter and smoother say what the numbers are
from whatever is visible, and A, C, Q, R and the start are learnt from that, in turns, until the
likelihood hardly grows. Missing coordinates are C z.

Where it departs from the paper and from the authors' program:

* Only what is visible is learnt from. DynaMMo fills the gaps first, by straight lines, and then
  takes what it filled for observations, which holds each gap to where it began. (The likelihood of
  what is visible never falls here; that of DynaMMo is of data that change.)
* R is diagonal and Q any covariance; in the program both are a number times the identity unless
  asked otherwise. Variances have a floor.
* It starts from the principal components of the clip with its gaps bridged by straight lines, and
  how they go on from frame to frame; the program starts from random numbers.

References
----------
.. [LMPF09] L. Li, J. McCann, N. Pollard and C. Faloutsos, DynaMMo: Mining and Summarization of
   Coevolving Sequences with Missing Values, KDD 2009, doi 10.1145/1557019.1557078. Learning is as
   in Ghahramani and Hinton, Parameter Estimation for Linear Dynamical Systems, CRG-TR-96-2, 1996.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap
from priorfill.methods.task import Estimate, Task

__all__ = [
    "LdsModel",
    "LdsOptions",
    "Observations",
    "SmoothedStates",
    "fill",
    "first_model",
    "learn",
    "smooth",
]

Array = NDArray[np.float64]

SETTLED = 1e-9
"""A covariance that changes by less than this share from one frame to the next is the same."""

FAR = 1000.0
"""mm. Beyond what is measured of a marker: a limb may swing out of it, but no farther than it is
long."""

LED_AWAY = "the system leads it far from where it is ever seen; use auto"
REASON = "it is never seen; use a method that learns from other recordings"


@dataclass(frozen=True)
class LdsOptions:
    """LdsOptions of `fill`.

    Attributes
    ----------
    hidden : int
        How many hidden numbers: 10 where Gløersen and Federolf 2016 compare DynaMMo.
    iterations : int
        At most so many rounds of learning; 10 in DynaMMo, from random numbers. Beyond 20, gaps in
        treadmill walking (WalkL of Gløersen and Federolf 2016) are filled no better.
    tolerance : float
        Learning ends where the log-likelihood grows by less than this share: 1e-5 in DynaMMo.
    least_deviation : float
        Neither the hidden numbers nor what is measured move less at random than this (mm); the
        noise of good cameras is some tenths.
    """

    hidden: int = 10
    iterations: int = 20
    tolerance: float = 1e-5
    least_deviation: float = 0.01


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
        Mean of the first hidden numbers.
    start_covariance : ndarray [shape=(k, k), mm²]
        Their covariance.
    """

    transition: Array
    emission: Array
    process: Array
    noise: Array
    start: Array
    start_covariance: Array


class Observations:
    """What is visible, arranged for filter and learning.

    Parameters
    ----------
    observed : ndarray [shape=(frames, d), mm]
        Centred; NaN where missing.

    Attributes
    ----------
    values : ndarray [shape=(frames, d), mm]
        Zero where missing.
    patterns : ndarray of bool [shape=(patterns, d)]
        The sets of coordinates that are visible together.
    which : ndarray of int [shape=(frames,)]
        The pattern of each frame.
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
    """What filter and smoother say of the hidden numbers, given all that is visible.

    Attributes
    ----------
    means : ndarray [shape=(frames, k)]
        Of the hidden numbers.
    first, last : ndarray [shape=(k, k)]
        Covariance in the first and the last frame.
    covariances : ndarray [shape=(patterns, k, k)]
        Covariances summed over the frames of each pattern.
    lagged : ndarray [shape=(k, k)]
        Sum of the covariances of each frame's numbers with those of the frame before.
    likelihood : float
        Logarithm of the likelihood of what is visible.
    """

    means: Array
    first: Array
    last: Array
    covariances: Array
    lagged: Array
    likelihood: float


def _symmetric(matrix: Array) -> Array:
    """Return a matrix without the rounding errors of its antisymmetric part."""
    return 0.5 * (matrix + matrix.T)


def _floored(covariance: Array, least: float) -> Array:
    """Return the covariance of highest likelihood whose variances are not below a floor."""
    values, vectors = np.linalg.eigh(_symmetric(covariance))
    return _symmetric((vectors * np.maximum(values, least)) @ vectors.T)


def _updated(predicted: Array, information: Array) -> tuple[Array, float]:
    """Return (P^-1 + G)^-1 and log det(I + P G) of a covariance P and an information G.

    With P = L L' it is L (I + L' G L)^-1 L': symmetric, never negative, and what is inverted has no
    eigenvalue below 1.
    """
    root = np.linalg.cholesky(predicted)
    factor = np.linalg.cholesky(np.eye(len(root)) + root.T @ information @ root)
    half = np.linalg.solve(factor, root.T)
    return half.T @ half, 2.0 * float(np.log(np.diag(factor)).sum())


def _same(one: Array, other: Array) -> bool:
    return bool(abs(one - other).max() <= SETTLED * abs(other).max())


class _Forward:
    """The Kalman filter, in information form: d coordinates cost no more than k.

    In a run of frames with one pattern the covariances soon stay as they are; from then on a frame
    costs one product of a matrix with a vector.
    """

    def __init__(self, model: LdsModel, visible: Observations) -> None:
        weighted = model.emission / model.noise[:, None]
        # sum of c c' / r over the coordinates of each pattern
        products = weighted[:, :, None] * model.emission[:, None]
        k = len(model.transition)
        flat = visible.patterns.astype(np.float64) @ products.reshape(-1, k * k)
        self._information = flat.reshape(-1, k, k)
        self._told = visible.values @ weighted
        self._which = visible.which
        self._model = model
        self.predicted: list[Array] = []
        self.updated: list[Array] = []
        frames = len(visible.values)
        # the number of each frame's covariances in these lists
        self.number = np.empty(frames, dtype=np.intp)
        self.means = np.empty((frames, k))
        constant = visible.patterns @ (np.log(2.0 * np.pi * model.noise))
        squares = (visible.values**2) @ (1.0 / model.noise)
        self._twice = float(constant[self._which].sum() + squares.sum())
        self._run()
        self.likelihood = -0.5 * self._twice

    def _run(self) -> None:
        a = self._model.transition
        mean, predicted = self._model.start, self._model.start_covariance
        determinant = 0.0
        settled = False
        for frame, pattern in enumerate(self._which):
            information = self._information[pattern]
            same = frame > 0 and pattern == self._which[frame - 1]
            if frame:
                mean = a @ mean
            if not (same and settled):
                if frame:
                    predicted = _symmetric(a @ self.updated[-1] @ a.T) + self._model.process
                settled = same and _same(predicted, self.predicted[-1])
                if not settled:
                    updated, determinant = _updated(predicted, information)
                    self.predicted.append(predicted)
                    self.updated.append(updated)
            self.number[frame] = len(self.updated) - 1
            told = self._told[frame]
            news = told - information @ mean
            correction = self.updated[-1] @ news
            # e' S^-1 e of what was not expected, e; the squares of x are in the sum already
            self._twice += determinant - float(mean @ (told + news)) - float(news @ correction)
            mean = mean + correction
            self.means[frame] = mean


def smooth(model: LdsModel, visible: Observations) -> SmoothedStates:
    """Return what is known of the hidden numbers: Kalman filter, Rauch-Tung-Striebel smoother."""
    forward = _Forward(model, visible)
    a = model.transition
    identity = np.eye(len(a))
    means = forward.means.copy()
    covariance = forward.updated[forward.number[-1]]
    last = covariance
    sums = np.zeros((len(visible.patterns), *a.shape))
    sums[visible.which[-1]] += covariance
    lagged = np.zeros_like(a)
    step: tuple[int, int] | None = None
    settled = False
    back: Array
    base: Array
    rest: Array
    for frame in range(len(means) - 2, -1, -1):
        here = (int(forward.number[frame]), int(forward.number[frame + 1]))
        if here != step:
            step, settled = here, False
            updated = forward.updated[here[0]]
            back = np.asarray(np.linalg.solve(forward.predicted[here[1]], a @ updated)).T
            rest = identity - back @ a
            # Joseph's form: a sum of squares, whatever the rounding
            base = rest @ updated @ rest.T + back @ model.process @ back.T
        lagged += covariance @ back.T
        if not settled:
            before = covariance
            covariance = _symmetric(base + back @ covariance @ back.T)
            settled = _same(covariance, before)
        sums[visible.which[frame]] += covariance
        means[frame] = rest @ forward.means[frame] + back @ means[frame + 1]
    return SmoothedStates(means, covariance, last, sums, lagged, forward.likelihood)


def _learnt(smoothed: SmoothedStates, visible: Observations, least: float) -> LdsModel:
    """Return the model of highest expected likelihood (the M-step)."""
    means, values = smoothed.means, visible.values
    frames, k = means.shape
    total = smoothed.covariances.sum(axis=0)
    start_covariance = _floored(smoothed.first, least)
    transition: Array = np.eye(k)
    process: Array = np.eye(k) * least
    if frames > 1:
        before = means[:-1].T @ means[:-1] + total - smoothed.last
        after = means[1:].T @ means[1:] + total - smoothed.first
        lagged = means[1:].T @ means[:-1] + smoothed.lagged
        transition = np.asarray(np.linalg.solve(before, lagged.T), dtype=np.float64).T
        mixed = transition @ lagged.T
        spread = after - mixed - mixed.T + transition @ before @ transition.T
        process = _floored(spread / (frames - 1), least)
    # sum of z z' over the frames that show each coordinate
    outer = smoothed.covariances.copy()
    order = np.argsort(visible.which, kind="stable")
    edges = np.searchsorted(visible.which[order], np.arange(len(outer) + 1))
    for number in range(len(outer)):
        some = means[order[edges[number] : edges[number + 1]]]
        outer[number] += some.T @ some
    seen = visible.patterns.T.astype(np.float64) @ outer.reshape(len(outer), -1)
    squares = seen.reshape(-1, k, k)
    products = values.T @ means
    emission: Array = np.asarray(np.linalg.solve(squares, products[..., None]), dtype=np.float64)[
        ..., 0
    ]
    fitted = (emission * products).sum(axis=1)
    bent = np.einsum("di,dij,dj->d", emission, squares, emission)
    noise = np.maximum((visible.squares - 2.0 * fitted + bent) / visible.counts, least)
    return LdsModel(transition, emission, process, noise, means[0].copy(), start_covariance)


def first_model(observed: Array, hidden: int, least: float) -> LdsModel:
    """Return what learning starts from: principal components of the bridged clip.

    Parameters
    ----------
    observed : ndarray [shape=(frames, d), mm]
        Centred; NaN where missing.
    hidden : int
        How many hidden numbers at most.
    least : float
        Floor of variances (mm²).
    """
    bridged = observed.copy()
    frames = np.arange(len(observed))
    for column in bridged.T:
        seen = ~np.isnan(column)
        column[~seen] = np.interp(frames[~seen], frames[seen], column[seen])
    k = max(1, min(hidden, *bridged.shape))
    _, _, vectors = np.linalg.svd(bridged, full_matrices=False)
    emission = vectors[:k].T
    numbers = bridged @ emission
    noise = np.maximum((bridged - numbers @ emission.T).var(axis=0), least)
    transition, process = np.eye(k), np.eye(k) * least
    if len(numbers) > 1:
        transition = np.linalg.lstsq(numbers[:-1], numbers[1:], rcond=None)[0].T
        error = numbers[1:] - numbers[:-1] @ transition.T
        process = _floored(error.T @ error / len(error), least)
    return LdsModel(transition, emission, process, noise, numbers[0].copy(), process.copy())


def learn(
    observed: Array, options: LdsOptions, report: Callable[[float], None] | None = None
) -> tuple[LdsModel, SmoothedStates]:
    """Learn a linear dynamical system from what is visible.

    Parameters
    ----------
    observed : ndarray [shape=(frames, d), mm]
        Centred; NaN where missing, but no column of nothing else.
    options : LdsOptions
        How long, and with how many hidden numbers.
    report : callable, optional
        Called with the log-likelihood of each round.

    Returns
    -------
    LdsModel
        The one of highest likelihood.
    SmoothedStates
        The hidden numbers by it.
    """
    visible = Observations(observed)
    least = options.least_deviation**2
    model = first_model(observed, options.hidden, least)
    smoothed = smooth(model, visible)
    for _ in range(options.iterations):
        if report is not None:
            report(smoothed.likelihood)
        better = _learnt(smoothed, visible, least)
        again = smooth(better, visible)
        gain = again.likelihood - smoothed.likelihood
        if not gain > 0.0:
            break
        model, smoothed = better, again
        if gain <= options.tolerance * abs(smoothed.likelihood):
            break
    return model, smoothed


def fill(
    task: Task, progress: Callable[[], None] = lambda: None, options: LdsOptions | None = None
) -> Estimate:
    """Fill gaps by a linear dynamical system learnt from the clip.

    Parameters
    ----------
    task : Task
        The clip; takes are not looked at.
    progress : callable
        Called once a gap group.
    options : LdsOptions, optional
        The constants.

    Returns
    -------
    Estimate
        Markers that are never seen stay missing, and samples that the system leads `FAR` from
        where the marker is seen: a system that grows has no bounds in a long gap.
    """
    options = options or LdsOptions()
    positions = task.positions.copy()
    if task.groups and task.valid.any():
        seen = task.valid.any(axis=0)
        observed = positions[:, seen].reshape(len(positions), -1)
        middle = np.nanmean(observed, axis=0)
        model, smoothed = learn(observed - middle, options)
        found = smoothed.means @ model.emission.T + middle
        found = found.reshape(len(positions), -1, 3)
        least, most = (f(positions[:, seen], axis=0) for f in (np.nanmin, np.nanmax))
        away = ((found < least - FAR) | (found > most + FAR)).any(axis=2)
        found[away] = np.nan
        positions[:, seen] = found
    for _ in task.groups:
        progress()

    def reason(gap: Gap) -> str:
        return LED_AWAY if task.valid[:, gap.marker].any() else REASON

    return Estimate.told(task, positions, "a linear dynamical system of the clip", reason)

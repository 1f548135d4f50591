"""The training set of Li et al. 2020: pieces of the database that are like the clip.

The paper takes pieces of the clip's length from recordings of the same kind of motion of the same
person. Which these are is found here: those whose poses are nearest to the clip's, on a body whose
constant distances are nearest to those of the clip's body.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import evenly_spaced
from priorfill.methods.li2020.li2020_options import Li2020Options
from priorfill.search.takes import Take

__all__ = ["TrainingWindow", "choose_windows", "is_learnable"]

Array = NDArray[np.float64]

SAMPLE = 200
"""So many of the clip's poses are compared with; more lie so close that they say the same."""

FEWEST_FRAMES = 8
"""Pieces of fewer frames, at the coarsest resolution, are passed over: 1 s at 7.5 Hz."""

STEADY = 0.9
"""Markers are compared that are visible this share as often as the marker seen most."""

STIFFEST = 2
"""The body is told by this many pairs of markers per marker: those whose distances vary least."""


@dataclass(frozen=True, eq=False)
class TrainingWindow:
    """A stretch of a take with frames that show every marker.

    Attributes
    ----------
    name : str
        Of the take.
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where the take does not show a marker.
    rate : float
        Hz.
    """

    name: str
    positions: Array
    rate: float


def is_learnable(take: Take, markers: NDArray[np.intp]) -> bool:
    """Whether a take shows all of some markers somewhere."""
    return bool((take.shown[markers] > 0).all())


def _shape(poses: Array) -> Array:
    """Return poses without their means, a row each [shape=(n, 3 markers)]."""
    shape: Array = (poses - poses.mean(axis=1, keepdims=True)).reshape(len(poses), -1)
    return shape


def _distances(poses: Array, pairs: tuple[NDArray[np.intp], NDArray[np.intp]]) -> Array:
    """Return the distances of pairs of markers in some poses [shape=(poses, pairs)]."""
    return np.asarray(np.linalg.norm(poses[:, pairs[0]] - poses[:, pairs[1]], axis=2))


class _Likeness:
    """How far pieces are from a clip: in their poses, and in the body that moves."""

    def __init__(self, positions: Array, options: Li2020Options) -> None:
        valid = ~np.isnan(positions[..., 0])
        seen = valid.mean(axis=0)
        self.markers = np.flatnonzero(seen >= STEADY * seen.max())
        frames = np.flatnonzero(valid[:, self.markers].all(axis=1))
        if len(frames) == 0:  # no frame shows all of them: those of one frame then
            richest = int(valid.sum(axis=1).argmax())
            self.markers, frames = np.flatnonzero(valid[richest]), np.array([richest])
        poses = positions[frames[evenly_spaced(len(frames), SAMPLE)]][:, self.markers]
        self._poses = _shape(poses)
        self._norms = (self._poses**2).sum(axis=1)
        self._body = options.body
        pairs = np.triu_indices(len(self.markers), 1)
        lengths = _distances(poses, pairs)
        stiff = np.argsort(lengths.std(axis=0), kind="stable")[: STIFFEST * len(self.markers)]
        self._pairs = (pairs[0][stiff], pairs[1][stiff])
        self._lengths = lengths.mean(axis=0)[stiff]

    def body(self, poses: Array) -> float:
        """Return how far the constant distances of a body are from the clip's (mm)."""
        if len(self._lengths) == 0:
            return 0.0
        sample = poses[evenly_spaced(len(poses), SAMPLE)]
        return float(np.median(abs(_distances(sample, self._pairs).mean(axis=0) - self._lengths)))

    def poses(self, poses: Array) -> Array:
        """Return how far each pose is from the clip's nearest one (mm, rms over markers)."""
        rows = _shape(poses)
        squares = (rows**2).sum(axis=1)[:, None] + self._norms - 2.0 * rows @ self._poses.T
        nearest: Array = np.sqrt(np.maximum(squares.min(axis=1), 0.0) / len(self.markers))
        return nearest

    def distance(self, body: float, poses: Array) -> float:
        """Return how far a piece is from the clip (mm)."""
        return math.hypot(float(poses.mean()), self._body * body)


def choose_windows(
    positions: Array,
    rate: float,
    takes: Sequence[Take],
    markers: NDArray[np.intp],
    options: Li2020Options,
) -> list[TrainingWindow]:
    """Choose the pieces of takes that are most like a clip.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        The clip's ``markers``; NaN where missing.
    rate : float
        Of the clip (Hz).
    takes : sequence of Take
        The database.
    markers : ndarray of int
        Which of the clip's markers a piece must show.
    options : Li2020Options
        How many, and what is alike.

    Returns
    -------
    list of TrainingWindow
        At their finest resolution, the most alike first; none longer than the clip.
    """
    if not takes or np.isnan(positions[..., 0]).all():
        return []
    likeness = _Likeness(positions, options)
    seconds = len(positions) / rate
    ranked: list[tuple[float, int, int, float, float]] = []
    for number, take in enumerate(takes):
        if not is_learnable(take, markers):
            continue
        coarsest = len(take.rates) - 1
        poses = np.asarray(take.positions(coarsest, markers), dtype=np.float64)
        whole = ~np.isnan(poses[..., 0]).any(axis=1)
        compared = poses[:, likeness.markers]
        if whole.sum() < min(FEWEST_FRAMES, len(poses)) or not whole.any():
            continue
        body = likeness.body(compared[whole])
        apart = np.full(len(poses), np.nan)
        apart[whole] = likeness.poses(compared[whole])
        length = max(round(seconds * take.rates[coarsest]), FEWEST_FRAMES)
        for piece, start in enumerate(range(0, len(poses), length)):
            inside = apart[start : start + length]
            inside = inside[~np.isnan(inside)]
            if len(inside) >= FEWEST_FRAMES or (piece == 0 and len(inside)):
                begin = start / take.rates[coarsest]
                end = begin + length / take.rates[coarsest]
                ranked.append((likeness.distance(body, inside), number, piece, begin, end))
    pieces = []
    for _, number, _, begin, end in sorted(ranked)[: options.pieces]:
        take = takes[number]
        first, last = round(begin * take.rates[0]), round(end * take.rates[0])
        found = np.asarray(take.positions(0, markers), dtype=np.float64)[first:last]
        pieces.append(TrainingWindow(take.name, found, take.rates[0]))
    return pieces

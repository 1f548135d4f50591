"""The prior: target positions, velocities and accelerations of missing markers, with weights.

Each of Eqs. (2) to (4) of Baumann et al. 2011 sums over the k nearest poses y_i. Since
Σ w_i (y_i - x)² = W (ȳ - x)² + Σ w_i (y_i - ȳ)² with W = Σ w_i and the weighted mean ȳ, the sum is
folded into one target, one weight and one constant per sample, whatever k is.

Velocities and accelerations are displacements per frame step (mm): ν Δt and α Δt².
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootFrames

__all__ = ["Prior", "fold", "to_world"]


@dataclass(frozen=True, eq=False)
class Prior:
    """Targets and weights of the three energy terms over a window of frames.

    Attributes
    ----------
    pose : ndarray [shape=(frames, markers, 3), mm]
        Expected positions ȳ.
    velocity : ndarray [shape=(frames, markers, 3), mm]
        Expected central differences (x[t+1] - x[t-1]) / 2.
    acceleration : ndarray [shape=(frames, markers, 3), mm]
        Expected second differences x[t+1] - 2 x[t] + x[t-1].
    pose_weight, velocity_weight, acceleration_weight : ndarray [shape=(frames, markers)]
        Weights of the terms, 0 or more. Where a weight is 0, the target may be any finite number.
    constant : ndarray [shape=(frames, markers), mm²]
        Part of the energy that does not depend on the positions: the spread of the neighbours.
    """

    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    pose_weight: NDArray[np.float64]
    velocity_weight: NDArray[np.float64]
    acceleration_weight: NDArray[np.float64]
    constant: NDArray[np.float64]

    @classmethod
    def empty(cls, frames: int, markers: int) -> Prior:
        """Return a prior without any weight [shape=(frames, markers)]."""
        targets = [np.zeros((frames, markers, 3)) for _ in range(3)]
        weights = [np.zeros((frames, markers)) for _ in range(4)]
        return cls(*targets, *weights)

    def place(self, rows: NDArray[np.intp], columns: NDArray[np.intp], part: Prior) -> None:
        """Copy a part [shape=(rows, columns)] into this prior, in place."""
        for name in (field.name for field in fields(self)):
            getattr(self, name)[np.ix_(rows, columns)] = getattr(part, name)


def fold(
    values: NDArray[np.float64], weights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Fold the values of the k neighbours into mean, weight and constant.

    Parameters
    ----------
    values : ndarray [shape=(frames, k, markers, 3), mm]
        Value of each neighbour; NaN where it lacks the marker.
    weights : ndarray [shape=(frames, k)]
        Weight of each neighbour; Baumann et al. 2011 use 1.

    Returns
    -------
    mean : ndarray [shape=(frames, markers, 3), mm]
        Weighted mean of the known values; 0 where there are none.
    weight : ndarray [shape=(frames, markers)]
        Sum of the weights of the known values.
    constant : ndarray [shape=(frames, markers), mm²]
        Weighted sum of their squared distances from the mean.

    See Also
    --------
    to_world : Transforms the folded targets.

    Examples
    --------
    >>> values = np.array([[[[0.0, 0.0, 0.0]], [[4.0, 0.0, 0.0]]]])  # one frame, k = 2
    >>> mean, weight, constant = fold(values, np.array([[3.0, 1.0]]))
    >>> mean[0, 0], weight[0, 0], constant[0, 0]
    (array([1., 0., 0.]), np.float64(4.0), np.float64(12.0))
    """
    known = ~np.isnan(values[..., 0])
    votes = np.where(known, weights[:, :, None], 0.0)  # (frames, k, markers)
    values = np.where(known[..., None], values, 0.0)
    weight = votes.sum(axis=1)
    divisor = np.where(weight > 0, weight, 1.0)
    mean = np.einsum("fkm,fkmi->fmi", votes, values) / divisor[..., None]
    spread = ((values - mean[:, None]) ** 2).sum(axis=3)
    return mean, weight, np.einsum("fkm,fkm->fm", votes, spread)


def to_world(
    pose: NDArray[np.float64],
    velocity: NDArray[np.float64],
    acceleration: NDArray[np.float64],
    before: RootFrames,
    here: RootFrames,
    after: RootFrames,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Transform targets from root frames to world coordinates.

    The expected poses one step before and after each frame are transformed with the root frames of
    those steps, and their differences are taken in world coordinates. Where the heading of the root
    is constant, the energy has the same value as in root frames.

    Parameters
    ----------
    pose, velocity, acceleration : ndarray [shape=(frames, markers, 3), mm]
        Targets in the root frames of the query, as displacements per frame step.
    before, here, after : RootFrames
        Root frames one step before each frame, at the frame, and one step after it.

    Returns
    -------
    pose, velocity, acceleration : ndarray [shape=(frames, markers, 3), mm]

    See Also
    --------
    fold : Computes the targets in root frames.
    """
    previous = before.to_world(pose - velocity + 0.5 * acceleration)
    current = here.to_world(pose)
    following = after.to_world(pose + velocity + 0.5 * acceleration)
    return current, 0.5 * (following - previous), following - 2.0 * current + previous

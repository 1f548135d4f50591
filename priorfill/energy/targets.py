"""What the prior says of a run of frames: positions, velocities and accelerations to be near.

The prior of a frame is an expectation for each missing marker and how much it weighs. The
neighbours' votes fold into it: Σ w_i (y_i - x)² = W (ȳ - x)² + Σ w_i (y_i - ȳ)², so whoever
minimises the energy handles one mean, one weight and one constant a sample, however many
neighbours voted.

Velocities and accelerations are given as displacements a frame step (mm): ν Δt and α Δt².
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
        Weights, not negative; 0 where a term says nothing. A target may be anything finite
        where its weight is 0.
    constant : ndarray [shape=(frames, markers)]
        What the neighbours' disagreement adds to the energy whatever the positions are.
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
        """Return a prior that says nothing [shape=(frames, markers)]."""
        targets = [np.zeros((frames, markers, 3)) for _ in range(3)]
        weights = [np.zeros((frames, markers)) for _ in range(4)]
        return cls(*targets, *weights)

    def place(self, rows: NDArray[np.intp], columns: NDArray[np.intp], part: Prior) -> None:
        """Write a part [shape=(rows, columns)] into this prior, in place."""
        for name in (field.name for field in fields(self)):
            getattr(self, name)[np.ix_(rows, columns)] = getattr(part, name)


def fold(
    values: NDArray[np.float64], weights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Fold the neighbours' votes into mean, weight and constant.

    Parameters
    ----------
    values : ndarray [shape=(frames, k, markers, 3), mm]
        What each neighbour says; NaN where it has nothing to say.
    weights : ndarray [shape=(frames, k)]
        How much each neighbour counts.

    Returns
    -------
    mean : ndarray [shape=(frames, markers, 3), mm]
        0 where nobody votes.
    weight : ndarray [shape=(frames, markers)]
        Sum of the weights of those who vote.
    constant : ndarray [shape=(frames, markers), mm²]
        Weighted sum of their squared distances from the mean.
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
    """Bring targets from the root frames into the world.

    The poses that the prior expects one step before and after a frame are carried over with
    the root frames of those steps, and differenced in the world. Where the root keeps its
    heading, the energy's value is that in the root frame.

    Parameters
    ----------
    pose, velocity, acceleration : ndarray [shape=(frames, markers, 3), mm]
        Targets in the root frames of the query, as displacements a frame step.
    before, here, after : RootFrames
        Of the frames themselves and of one step before and after them.

    Returns
    -------
    pose, velocity, acceleration : ndarray [shape=(frames, markers, 3), mm]
    """
    previous = before.to_world(pose - velocity + 0.5 * acceleration)
    current = here.to_world(pose)
    following = after.to_world(pose + velocity + 0.5 * acceleration)
    return current, 0.5 * (following - previous), following - 2.0 * current + previous

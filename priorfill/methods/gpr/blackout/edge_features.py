"""Features of a window's edges: poses, velocities and accelerations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootGroup, about_vertical
from priorfill.methods.gpr.blackout.options import BlackoutOptions

__all__ = ["edge_features"]

_Floats = NDArray[np.float64]


def edge_features(
    poses: _Floats,
    counts: Sequence[int],
    root: RootGroup,
    options: BlackoutOptions,
    step_seconds: float | None = None,
) -> tuple[_Floats, _Floats]:
    """Return the edge features of windows and the rotations of their root frames.

    Parameters
    ----------
    poses : ndarray [shape=(windows, frames, markers, 3), mm]
        Of each edge the pose adjacent to the blackout, then those one and two steps away from it:
        of three the acceleration is computed, of two the velocity.
    counts : sequence of int
        Poses of each edge.
    root : RootGroup
        Gives position and heading at each edge; the window's are between them.
    options : BlackoutOptions
        Weights of velocities and accelerations.
    step_seconds : float, optional
        s. Time between the poses; `BlackoutOptions.difference_seconds` by default.

    Returns
    -------
    features : ndarray [shape=(windows, features), mm]
    rotation : ndarray [shape=(windows, 3, 3)]

    See Also
    --------
    priorfill.methods.gpr.blackout.window_layout.WindowLayout.edge_frames : The frames of the poses.
    """
    step = options.difference_seconds if step_seconds is None else step_seconds
    at = np.cumsum([0, *counts[:-1]])
    nearest = poses[:, at]
    windows, edges, markers, _ = nearest.shape
    frames = root.frames(nearest.reshape(-1, markers, 3))
    origin = frames.origin.reshape(windows, edges, 3).mean(axis=1)
    turn = frames.rotation.reshape(windows, edges, 3, 3).sum(axis=1)
    rotation = about_vertical(turn[:, 0, 0], turn[:, 1, 0])
    local = np.einsum("wfmi,wij->wfmj", poses - origin[:, None, None], rotation)
    velocity_steps = options.velocity_seconds / step
    acceleration_steps = (options.acceleration_seconds / step) ** 2
    parts = []
    for first, count in zip(at, counts, strict=True):
        edge = local[:, first : first + count]
        parts.append(edge[:, 0])
        if count > 1:
            parts.append(velocity_steps * (edge[:, 0] - edge[:, 1]))
        if count > 2:
            parts.append(acceleration_steps * (edge[:, 0] - 2.0 * edge[:, 1] + edge[:, 2]))
    return np.concatenate([p.reshape(windows, -1) for p in parts], axis=1), rotation

"""The energy of a fill: how far positions, velocities and accelerations are from the prior.

Baumann et al. 2011, Eqs. (2)-(4), with the neighbours folded (see `priorfill.energy.targets`)::

    E_pose   = Σ_t w_p |x[t] - p[t]|²
    E_motion = Σ_t w_v |(x[t+1] - x[t-1]) / 2 - v[t]|²
    E_smooth = Σ_t w_a |x[t+1] - 2 x[t] + x[t-1] - a[t]|²

over the frames and markers where the weights are not 0. Markers do not mix, so each is a *chain*
of positions over time of its own, and its energy is, summed over the three coordinates, the
quadratic form xᵀAx - 2bᵀx + const with a symmetric matrix A of two bands beside the diagonal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.energy.targets import Prior

__all__ = ["BandedSystem", "banded_system", "energy", "gradient", "marker_energies"]


@dataclass(frozen=True, eq=False)
class BandedSystem:
    """The energy as quadratic forms, a chain for each marker.

    Attributes
    ----------
    diagonal, first, second : ndarray [shape=(markers, frames)]
        A[t, t], A[t, t+1] and A[t, t+2]: the same for the three coordinates of a marker.
    right : ndarray [shape=(markers, 3, frames), mm]
        b.
    """

    diagonal: NDArray[np.float64]
    first: NDArray[np.float64]
    second: NDArray[np.float64]
    right: NDArray[np.float64]


def _residuals(
    positions: NDArray[np.float64], prior: Prior
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the residuals of the three terms [shape=(frames, markers, 3), mm]."""
    pose = positions - prior.pose
    pose[prior.pose_weight == 0] = 0.0
    motion = np.zeros_like(positions)
    smooth = np.zeros_like(positions)
    motion[1:-1] = 0.5 * (positions[2:] - positions[:-2]) - prior.velocity[1:-1]
    smooth[1:-1] = positions[2:] - 2.0 * positions[1:-1] + positions[:-2] - prior.acceleration[1:-1]
    # a term without weight may touch samples that are unknown
    motion[prior.velocity_weight == 0] = 0.0
    smooth[prior.acceleration_weight == 0] = 0.0
    return pose, motion, smooth


def marker_energies(positions: NDArray[np.float64], prior: Prior) -> NDArray[np.float64]:
    """Energy of each marker [shape=(markers,), mm²]; parameters as for `energy`."""
    pose, motion, smooth = _residuals(positions, prior)
    energies: NDArray[np.float64] = (
        np.einsum("fm,fmi->m", prior.pose_weight, pose**2)
        + np.einsum("fm,fmi->m", prior.velocity_weight, motion**2)
        + np.einsum("fm,fmi->m", prior.acceleration_weight, smooth**2)
        + prior.constant.sum(axis=0)
    )
    return energies


def energy(positions: NDArray[np.float64], prior: Prior) -> float:
    """Energy of positions under a prior, mm².

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        May be NaN where no term with a weight reaches.
    prior : Prior
        Targets and weights over the same window. The first and the last frame have no
        velocity and acceleration terms: their differences leave the window.

    Returns
    -------
    float
        E_pose + E_motion + E_smooth, the neighbours' disagreement included.
    """
    return float(marker_energies(positions, prior).sum())


def gradient(positions: NDArray[np.float64], prior: Prior) -> NDArray[np.float64]:
    """Gradient of `energy` by every position [shape=(frames, markers, 3), mm]."""
    pose, motion, smooth = _residuals(positions, prior)
    motion *= prior.velocity_weight[..., None]
    smooth *= prior.acceleration_weight[..., None]
    slope = 2.0 * prior.pose_weight[..., None] * pose
    slope[2:] += motion[1:-1]
    slope[:-2] -= motion[1:-1]
    slope[2:] += 2.0 * smooth[1:-1]
    slope[1:-1] -= 4.0 * smooth[1:-1]
    slope[:-2] += 2.0 * smooth[1:-1]
    return slope


def banded_system(prior: Prior) -> BandedSystem:
    """Write the energy as a quadratic form for each chain.

    Parameters
    ----------
    prior : Prior
        Targets and weights [frames, markers].

    Returns
    -------
    Chains
        So that ``energy = xᵀAx - 2bᵀx + const`` for each marker and coordinate.
    """
    pose_weight = prior.pose_weight.T  # (markers, frames)
    velocity_weight = prior.velocity_weight.T.copy()
    acceleration_weight = prior.acceleration_weight.T.copy()
    for weight in (velocity_weight, acceleration_weight):
        weight[:, [0, -1]] = 0.0
    quarter = 0.25 * velocity_weight

    diagonal = pose_weight + 4.0 * acceleration_weight
    diagonal[:, 1:] += quarter[:, :-1] + acceleration_weight[:, :-1]
    diagonal[:, :-1] += quarter[:, 1:] + acceleration_weight[:, 1:]
    first = np.zeros_like(diagonal)
    first[:, :-1] = -2.0 * (acceleration_weight[:, :-1] + acceleration_weight[:, 1:])
    second = np.zeros_like(diagonal)
    second[:, :-2] = acceleration_weight[:, 1:-1] - quarter[:, 1:-1]

    half = 0.5 * velocity_weight[:, None] * prior.velocity.transpose(1, 2, 0)
    bend = acceleration_weight[:, None] * prior.acceleration.transpose(1, 2, 0)
    right = pose_weight[:, None] * prior.pose.transpose(1, 2, 0) - 2.0 * bend
    right[..., 1:] += half[..., :-1] + bend[..., :-1]
    right[..., :-1] += bend[..., 1:] - half[..., 1:]
    return BandedSystem(diagonal, first, second, right)

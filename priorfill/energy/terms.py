"""The energy of a fill: the distance of positions, velocities and accelerations from the prior.

Eq. (1) of [B11]_, E = E_pose + E_motion + E_smooth. The sums over the k neighbours in Eqs. (2) to
(4) are folded into one target and one weight per sample (see `priorfill.energy.targets`)::

    Eq. (2)  E_pose   = Σ_t w_p |x[t] - p[t]|²
    Eq. (3)  E_motion = Σ_t w_v |(x[t+1] - x[t-1]) / 2 - v[t]|²
    Eq. (4)  E_smooth = Σ_t w_a |x[t+1] - 2 x[t] + x[t-1] - a[t]|²

summed over the missing markers. [B11]_ has no weights; here they may differ between terms and
samples. A term without weight is left out. Markers are independent of each other. The positions of
one marker over time are a *chain*; its energy, summed over the three coordinates, is the quadratic
form xᵀAx - 2bᵀx + const, with a symmetric matrix A that has two bands on either side of the
diagonal.

References
----------
.. [B11] Baumann, Krüger, Zinke and Weber, Data-driven completion of motion capture data,
   VRIPHYS 2011, section 4.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.energy.targets import Prior

__all__ = ["BandedSystem", "banded_system", "energy", "gradient", "marker_energies"]


@dataclass(frozen=True, eq=False)
class BandedSystem:
    """The energy as quadratic forms xᵀAx - 2bᵀx + const, one per marker and coordinate.

    Attributes
    ----------
    diagonal, off1, off2 : ndarray [shape=(markers, frames)]
        A[t, t], A[t, t+1] and A[t, t+2], the same for the three coordinates of a marker.
    rhs : ndarray [shape=(markers, 3, frames), mm]
        b.
    """

    diagonal: NDArray[np.float64]
    off1: NDArray[np.float64]
    off2: NDArray[np.float64]
    rhs: NDArray[np.float64]


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
    # a term without weight may involve unknown samples
    motion[prior.velocity_weight == 0] = 0.0
    smooth[prior.acceleration_weight == 0] = 0.0
    return pose, motion, smooth


def marker_energies(positions: NDArray[np.float64], prior: Prior) -> NDArray[np.float64]:
    """Return the energy of each marker [shape=(markers,), mm²]; parameters as for `energy`."""
    pose, motion, smooth = _residuals(positions, prior)
    energies: NDArray[np.float64] = (
        np.einsum("fm,fmi->m", prior.pose_weight, pose**2)
        + np.einsum("fm,fmi->m", prior.velocity_weight, motion**2)
        + np.einsum("fm,fmi->m", prior.acceleration_weight, smooth**2)
        + prior.constant.sum(axis=0)
    )
    return energies


def energy(positions: NDArray[np.float64], prior: Prior) -> float:
    """Return the energy of positions under a prior: Eq. (1) of Baumann et al. 2011.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        May be NaN where no term with a weight involves them.
    prior : Prior
        Targets and weights over the same window. The first and the last frame have no velocity
        and acceleration terms, because their differences would need frames outside the window.

    Returns
    -------
    float
        mm². E_pose + E_motion + E_smooth, including the constant of the folded neighbours.

    See Also
    --------
    gradient : Its derivative.
    banded_system : The same as quadratic forms.
    priorfill.energy.solver.minimise : Minimises it.
    """
    return float(marker_energies(positions, prior).sum())


def gradient(positions: NDArray[np.float64], prior: Prior) -> NDArray[np.float64]:
    """Return the gradient of `energy` [shape=(frames, markers, 3), mm]; parameters alike."""
    pose, motion, smooth = _residuals(positions, prior)
    motion *= prior.velocity_weight[..., None]
    smooth *= prior.acceleration_weight[..., None]
    result = 2.0 * prior.pose_weight[..., None] * pose
    result[2:] += motion[1:-1]
    result[:-2] -= motion[1:-1]
    result[2:] += 2.0 * smooth[1:-1]
    result[1:-1] -= 4.0 * smooth[1:-1]
    result[:-2] += 2.0 * smooth[1:-1]
    return result


def banded_system(prior: Prior) -> BandedSystem:
    """Return the energy as quadratic forms, one per marker and coordinate.

    Parameters
    ----------
    prior : Prior
        Targets and weights [shape=(frames, markers)].

    Returns
    -------
    BandedSystem
        The minimum of the energy solves A x = b.

    See Also
    --------
    energy : The same as sums of squares.
    priorfill.energy.solver.solve_exactly : Solves it.
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
    off1 = np.zeros_like(diagonal)
    off1[:, :-1] = -2.0 * (acceleration_weight[:, :-1] + acceleration_weight[:, 1:])
    off2 = np.zeros_like(diagonal)
    off2[:, :-2] = acceleration_weight[:, 1:-1] - quarter[:, 1:-1]

    scaled_velocity = 0.5 * velocity_weight[:, None] * prior.velocity.transpose(1, 2, 0)
    scaled_acceleration = acceleration_weight[:, None] * prior.acceleration.transpose(1, 2, 0)
    rhs = pose_weight[:, None] * prior.pose.transpose(1, 2, 0) - 2.0 * scaled_acceleration
    rhs[..., 1:] += scaled_velocity[..., :-1] + scaled_acceleration[..., :-1]
    rhs[..., :-1] += scaled_acceleration[..., 1:] - scaled_velocity[..., 1:]
    return BandedSystem(diagonal, off1, off2, rhs)

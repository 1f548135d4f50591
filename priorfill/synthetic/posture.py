"""Standing at ease, and smooth movement between postures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.synthetic.kinematics import JointTrajectories
from priorfill.synthetic.synthetic_body import SIDES
from priorfill.synthetic.synthetic_options import Style

__all__ = ["bend_legs", "minimum_jerk", "stand"]

Array = NDArray[np.float64]

STANDING_KNEE = 6.0
"""Knee flexion (degrees) in standing; the knees are not locked."""

THIGH_SHARE = 0.72
"""Inclination of the thigh relative to the knee flexion. The rest is the shank: 29 degrees at a
knee flexion of 105 degrees; with the heels on the floor the ankle allows about 38 degrees
(Hemmerich et al., J. Orthop. Res. 24, 2006)."""


def minimum_jerk(progress: Array) -> Array:
    """Return the minimum-jerk trajectory, from 0 to 1, of a movement from rest to rest.

    Flash and Hogan, J. Neurosci. 5 (1985): 10 s³ − 15 s⁴ + 6 s⁵, constant outside 0 to 1.

    Examples
    --------
    >>> minimum_jerk(np.array([0.0, 0.5, 2.0]))
    array([0. , 0.5, 1. ])
    """
    s = np.clip(progress, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def bend_legs(joints: JointTrajectories, knee: Array) -> None:
    """Set both legs to a knee angle [shape=(frames,), degrees] with the soles flat."""
    for name in SIDES:
        joints[f"{name}knee_flexion"][:] = knee
        joints[f"{name}hip_flexion"][:] = THIGH_SHARE * knee
        joints[f"{name}ankle_dorsiflexion"][:] = (1.0 - THIGH_SHARE) * knee


def stand(frames: int, style: Style) -> JointTrajectories:
    """Return standing at ease with the arms hanging."""
    joints = JointTrajectories.standing(frames)
    bend_legs(joints, np.full(frames, STANDING_KNEE))
    joints["lumbar_flexion"][:] = 1.0 + style.lean
    joints["neck_flexion"][:] = -0.7 * style.lean
    for name in SIDES:
        joints[f"{name}foot_rotation"][:] = -style.toe_out
        joints[f"{name}shoulder_flexion"][:] = -2.0
        joints[f"{name}shoulder_abduction"][:] = 10.0
        joints[f"{name}shoulder_rotation"][:] = 12.0
        joints[f"{name}elbow_flexion"][:] = 18.0
        joints[f"{name}forearm_pronation"][:] = 12.0
        joints[f"{name}wrist_flexion"][:] = 6.0
    return joints

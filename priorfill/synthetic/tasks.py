"""Joint trajectories of reaching and squatting, with the feet in place.

The amplitudes of reaches are plausible, not published; their time course has minimum jerk. Squats
follow [S10] in `gait_curves`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.synthetic.gait_curves import SQUAT_KNEE
from priorfill.synthetic.kinematics import JointTrajectories
from priorfill.synthetic.posture import (
    STANDING_KNEE,
    bend_legs,
    minimum_jerk,
    stand,
)
from priorfill.synthetic.synthetic_body import SIDES, SyntheticSkeleton
from priorfill.synthetic.synthetic_options import Style

__all__ = ["reaching", "squatting"]

Array = NDArray[np.float64]

STANCE_ABDUCTION = 3.0
"""Abduction of the hips (degrees) with the feet about as far apart as the shoulders."""


def _bouts(
    time: Array, rng: np.random.Generator, durations: tuple[float, float], spread: float
) -> list[tuple[Array, NDArray[np.bool_]]]:
    """Divide time into repetitions; return the course 0-1-0 of each, and its frames.

    Parameters
    ----------
    time : ndarray [shape=(frames,), s]
        Time.
    rng : Generator
        Source of the random lengths.
    durations : tuple of float
        Mean duration (s) of the movement out or back, and of each rest.
    spread : float
        Relative standard deviation of the durations.
    """
    move, rest = durations
    bouts: list[tuple[Array, NDArray[np.bool_]]] = []
    start = time[0] - rng.uniform(0.0, move)
    while start < time[-1]:
        out, hold, back, pause = np.array([move, rest, move, rest]) * (
            1.0 + spread * np.clip(rng.standard_normal(4), -2.0, 2.0)
        )
        course = minimum_jerk((time - start) / out)
        course = course - minimum_jerk((time - start - out - hold) / back)
        end = start + out + hold + back + pause
        bouts.append((course, (time >= start) & (time < end)))
        start = end
    return bouts


def _widen(joints: JointTrajectories) -> None:
    for name in SIDES:
        joints[f"{name}hip_adduction"][:] -= STANCE_ABDUCTION


def reaching(
    time: Array, rate: float, skeleton: SyntheticSkeleton, style: Style, rng: np.random.Generator
) -> JointTrajectories:
    """Return reaching while standing, with one or both hands: low, level, high or sideways."""
    joints = stand(len(time), style)
    _widen(joints)
    knee = np.full(len(time), STANDING_KNEE)
    spread = 0.12 * style.variability
    for turn, (course, _) in enumerate(_bouts(time, rng, (0.85, 0.3), spread)):
        hands = ((0,), (1,), (0, 1))[(turn + int(rng.integers(2))) % 3]
        height = rng.uniform(-1.0, 1.0)  # low, level, high
        aside = rng.uniform(-0.3, 1.0) if len(hands) == 1 else 0.0
        go = course * style.amplitude
        low, high = max(0.0, -height), max(0.0, height)
        knee += go * 45.0 * low
        joints["pelvis_tilt"][:] += go * 22.0 * low
        joints["lumbar_flexion"][:] += go * (6.0 + 24.0 * low - 8.0 * high)
        joints["neck_flexion"][:] += go * (-8.0 * low - 14.0 * high + 4.0)
        if len(hands) == 1:
            toward = (1.0, -1.0)[hands[0]]
            # the reaching shoulder moves forwards; to the side, the trunk rotates with it
            joints["pelvis_rotation"][:] += go * toward * (-4.0 + 10.0 * aside)
            joints["lumbar_rotation"][:] += go * toward * (-8.0 + 22.0 * aside)
            joints["lumbar_side"][:] += go * toward * (5.0 * high - 7.0 * low)
            joints["neck_rotation"][:] += go * toward * 14.0 * aside
            # the weight shifts to the side of the hand
            for name, sign in zip(SIDES, (1.0, -1.0), strict=True):
                joints[f"{name}hip_adduction"][:] += go * sign * toward * (1.5 + 2.5 * aside)
        for hand in hands:
            name = SIDES[hand]
            joints[f"{name}shoulder_flexion"][:] += go * (82.0 + 58.0 * height)
            joints[f"{name}shoulder_abduction"][:] += go * (2.0 + 28.0 * max(aside, 0.0))
            joints[f"{name}shoulder_rotation"][:] -= go * rng.uniform(0.0, 20.0)
            joints[f"{name}elbow_flexion"][:] += go * (rng.uniform(-8.0, 22.0)) + 60.0 * course * (
                1.0 - course
            )
            joints[f"{name}clavicle_elevation"][:] += go * (6.0 + 14.0 * high)
            joints[f"{name}clavicle_protraction"][:] += go * 8.0
            joints[f"{name}forearm_pronation"][:] += go * rng.uniform(0.0, 35.0)
            joints[f"{name}wrist_flexion"][:] -= go * rng.uniform(0.0, 20.0)
    bend_legs(joints, knee)
    return joints


def squatting(
    time: Array, rate: float, skeleton: SyntheticSkeleton, style: Style, rng: np.random.Generator
) -> JointTrajectories:
    """Return repeated squats, with the arms forwards for balance."""
    joints = stand(len(time), style)
    _widen(joints)
    depth = np.zeros(len(time))
    for course, _ in _bouts(time, rng, (1.15, 0.3), 0.08 * style.variability):
        depth += course * (1.0 + 0.04 * style.variability * float(np.clip(rng.normal(), -2, 2)))
    depth *= style.amplitude
    bend_legs(joints, STANDING_KNEE + (SQUAT_KNEE - STANDING_KNEE) * depth)
    joints["pelvis_tilt"][:] += 22.0 * depth
    joints["lumbar_flexion"][:] += 20.0 * depth
    joints["neck_flexion"][:] -= 26.0 * depth
    for name in SIDES:
        joints[f"{name}hip_adduction"][:] -= 8.0 * depth
        joints[f"{name}foot_rotation"][:] -= 6.0
        joints[f"{name}shoulder_flexion"][:] += 95.0 * depth
        joints[f"{name}shoulder_rotation"][:] -= 8.0 * depth
        joints[f"{name}elbow_flexion"][:] -= 6.0 * depth
        joints[f"{name}clavicle_protraction"][:] += 8.0 * depth
        joints[f"{name}forearm_pronation"][:] += 25.0 * depth
    return joints

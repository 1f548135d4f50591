"""Joint trajectories of walking, running, walking along a curve, and turning on the spot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from priorfill.errors import OptionError
from priorfill.synthetic.gait_curves import (
    RUNNING,
    STEPPING,
    WALKING,
    GaitCurves,
)
from priorfill.synthetic.grounding import root_velocity
from priorfill.synthetic.kinematics import JointTrajectories
from priorfill.synthetic.noise import smooth_noise
from priorfill.synthetic.posture import stand
from priorfill.synthetic.synthetic_body import SIDES, SyntheticSkeleton
from priorfill.synthetic.synthetic_options import Style

__all__ = ["pivoting", "running", "turning", "walking"]

Array = NDArray[np.float64]

WALK_RATIO = 0.0065
"""Walk ratio: step length divided by cadence (m per step/min), for a height of 1.75 m; Sekiya and
Nagasaki, Gait and Posture 7 (1998)."""

WALKING_SPEEDS = 0.6, 1.25, 2.1
"""Slowest, natural and fastest (m/s)."""

TURNING_SPEED = 1.1
"""Natural speed along a curve (m/s)."""

RUNNING_SPEEDS = 2.2, 3.2, 4.5
"""Slowest, natural ([N98] in `gait_curves`) and fastest (m/s)."""

PIVOT_RATE = 75.0
"""Greatest rate of turning on the spot (degrees/s)."""

CONTACT_EDGE = 0.008
"""Share of the cycle in which the load is transferred to a foot (scale of a sigmoid)."""

CADENCE_SD = 0.015
"""Variation of the cadence from cycle to cycle: 1 to 3 % in healthy walking (Hausdorff,
J. NeuroEngineering and Rehabilitation 2, 2005)."""

KNEE_SHARE, PELVIS_SHARE = 0.35, 0.8
"""Increase of knee flexion and pelvis rotation relative to that of the range of the hips."""


def _window(phase: Array, start: float, end: float, edge: float) -> Array:
    """Return 1 between two phases and 0 elsewhere, with sigmoid edges."""
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    distance = np.abs(np.mod(phase - middle + 0.5, 1.0) - 0.5)
    return np.asarray(1.0 / (1.0 + np.exp(np.clip((distance - half) / edge, -50.0, 50.0))))


def cycle(
    curves: GaitCurves, phase: Array, style: Style, skeleton: SyntheticSkeleton, extent: float
) -> JointTrajectories:
    """Return the joint trajectories of a gait.

    Parameters
    ----------
    curves : GaitCurves
        The gait.
    phase : ndarray [shape=(frames,), cycles]
        Phase of the left leg.
    style : Style
        Arm swing, step width, toe-out, lean.
    skeleton : SyntheticSkeleton
        For the hip angles of the step width.
    extent : float
        Factor on the range of the hips, which determines the step length.
    """
    joints = stand(len(phase), style)
    turn = 2.0 * np.pi * phase
    share = 1.0 + PELVIS_SHARE * (extent - 1.0)
    rotation = -curves.pelvis_rotation * share * np.cos(turn)
    # the pelvis drops on the swing side
    drop = curves.pelvis_list * np.cos(turn - 2.0 * np.pi * 0.24)
    thorax = curves.thorax_rotation * np.cos(turn)
    nod = 1.0 * np.cos(2.0 * turn - 0.6)
    joints["pelvis_tilt"][:] = curves.pelvis_tilt
    joints["pelvis_list"][:] = drop
    joints["pelvis_rotation"][:] = rotation
    joints["lumbar_flexion"][:] = curves.trunk_lean + style.lean + nod
    joints["lumbar_side"][:] = -0.8 * drop
    joints["lumbar_rotation"][:] = thorax - rotation
    # the head keeps looking ahead
    joints["neck_flexion"][:] = -0.7 * (nod + curves.trunk_lean + style.lean) - curves.pelvis_tilt
    joints["neck_side"][:] = -0.15 * drop
    joints["neck_rotation"][:] = -0.85 * thorax

    hip_half = float(abs(skeleton.offsets["lthigh"][1]))
    inwards = np.arcsin((hip_half - 0.5 * style.step_width) / (skeleton.thigh + skeleton.shank))
    middle = 0.5 * (
        curves.hip(np.linspace(0, 1, 200)).max() + curves.hip(np.linspace(0, 1, 200)).min()
    )
    swing = style.arm_swing
    for side, (name, sign) in enumerate(zip(SIDES, (1.0, -1.0), strict=True)):
        own = phase + 0.5 * side
        joints[f"{name}hip_flexion"][:] = middle + extent * (curves.hip(own) - middle)
        joints[f"{name}hip_adduction"][:] = (
            np.rad2deg(inwards) + sign * drop + curves.sway * np.cos(2.0 * np.pi * (own - 0.31))
        )
        joints[f"{name}hip_rotation"][:] = 0.9 * sign * rotation
        joints[f"{name}knee_flexion"][:] = curves.knee(own) * (1.0 + KNEE_SHARE * (extent - 1.0))
        joints[f"{name}ankle_dorsiflexion"][:] = curves.ankle(own)
        # the arm swings back while the leg of the same side swings forwards
        back = np.cos(2.0 * np.pi * (own - 0.02))
        joints[f"{name}shoulder_flexion"][:] = (
            curves.shoulder[0] - swing * curves.shoulder[1] * back
        )
        joints[f"{name}elbow_flexion"][:] = curves.elbow[0] - swing * curves.elbow[1] * np.cos(
            2.0 * np.pi * (own - 0.06)
        )
        joints[f"{name}shoulder_abduction"][:] = curves.shoulder_abduction + 2.0 * swing * back
        joints[f"{name}shoulder_rotation"][:] = curves.shoulder_rotation - 6.0 * swing * back
        joints[f"{name}clavicle_protraction"][:] = -2.5 * swing * back
        joints[f"{name}wrist_flexion"][:] = 6.0 + 4.0 * swing * np.cos(2.0 * np.pi * (own - 0.15))
        joints.contact[:, side] = _window(own, 0.0, curves.toe_off, CONTACT_EDGE)
        joints.flat[:, side] = _window(own, *curves.flat, 0.015)
    return joints


def _extent(curves: GaitCurves, style: Style, skeleton: SyntheticSkeleton, step: float) -> float:
    """Return the extent that produces steps of a given length (mm)."""
    samples = 100
    phase = np.arange(3 * samples) / samples

    def length(extent: float) -> float:
        joints = cycle(curves, phase, style, skeleton, extent)
        # a frame is 1/samples of a cycle, which counts as one second
        velocity = root_velocity(joints, skeleton, rate=float(samples))
        return float(velocity[samples : 2 * samples, 0].mean()) / 2.0

    low, high = 0.35, 1.9
    at_low, at_high = length(low), length(high)
    if not at_low <= step <= at_high:
        raise OptionError(
            f"steps of {step:.0f} mm are out of reach for this body ({at_low:.0f} to "
            f"{at_high:.0f} mm); change the speed or the cadence"
        )
    for _ in range(6):  # false position: the length is nearly linear in the extent
        guess = low + (high - low) * (step - at_low) / (at_high - at_low)
        found = length(guess)
        if found < step:
            low, at_low = guess, found
        else:
            high, at_high = guess, found
        if abs(found - step) < 0.002 * step:
            break
    return float(guess)


def _phase(
    cadence: float, time: Array, rate: float, style: Style, rng: np.random.Generator
) -> Array:
    rate_of_cycles = cadence / 120.0
    noise = smooth_noise((len(time),), 0.5 * rate_of_cycles, rate, rng)
    steady = rate_of_cycles * (1.0 + style.variability * CADENCE_SD * noise)
    return np.asarray(rng.uniform() + np.cumsum(steady) / rate)


def _checked_speed(
    motion: str, speed: float | None, natural: float, range_: tuple[float, float]
) -> float:
    if speed is None:
        return natural
    if not range_[0] <= speed <= range_[1]:
        raise OptionError(
            f"the speed of {motion} is {speed:g} m/s; give a value from "
            f"{range_[0]:g} to {range_[1]:g}"
        )
    return speed


def _walk(
    motion: str, natural: float, time: Array, rate: float, skeleton: SyntheticSkeleton,
    style: Style, rng: np.random.Generator,
) -> JointTrajectories:  # fmt: skip
    slowest, _, fastest = WALKING_SPEEDS
    speed = _checked_speed(motion, style.speed, natural, (slowest, fastest))
    # step length = ratio * cadence and speed = step length * cadence / 60; both lengths scale
    # with the length of the leg
    size = (skeleton.thigh + skeleton.shank) / 859.0
    cadence = style.cadence or float(np.sqrt(60.0 * speed / (WALK_RATIO * size)))
    extent = _extent(WALKING, style, skeleton, 60e3 * speed / cadence)
    return cycle(WALKING, _phase(cadence, time, rate, style, rng), style, skeleton, extent)


def walking(
    time: Array, rate: float, skeleton: SyntheticSkeleton, style: Style, rng: np.random.Generator
) -> JointTrajectories:
    """Return walking straight ahead."""
    return _walk("walking", WALKING_SPEEDS[1], time, rate, skeleton, style, rng)


def turning(
    time: Array, rate: float, skeleton: SyntheticSkeleton, style: Style, rng: np.random.Generator
) -> JointTrajectories:
    """Return walking along a winding path, with alternating curves of about 4 s."""
    joints = _walk("turning", TURNING_SPEED, time, rate, skeleton, style, rng)
    wave = np.sin(2.0 * np.pi * (time / 8.0 + rng.uniform(0.0, 0.5)))
    bend = np.tanh(2.5 * wave)
    joints.turn[:] = style.turn_rate * bend
    # the head turns first, then the trunk, and the body leans into the curve
    ahead = bend * style.turn_rate / 35.0
    joints["neck_rotation"][:] += 9.0 * ahead
    joints["lumbar_rotation"][:] += 4.0 * ahead
    joints["lumbar_side"][:] -= 2.0 * ahead
    return joints


def pivoting(
    time: Array, rate: float, skeleton: SyntheticSkeleton, style: Style, rng: np.random.Generator
) -> JointTrajectories:
    """Return turning on the spot by stepping, to one side and, after a pause, back."""
    cadence = style.cadence or 105.0
    stepping = cycle(STEPPING, _phase(cadence, time, rate, style, rng), style, skeleton, 1.0)
    standing = stand(len(time), style)
    wave = np.sin(2.0 * np.pi * (time / 6.0 + rng.uniform(0.0, 0.5)))
    turn = PIVOT_RATE * np.tanh(3.0 * wave) * np.abs(wave) ** 0.5
    busy = gaussian_filter1d((np.abs(wave) > 0.25).astype(np.float64), 0.12 * rate, mode="nearest")
    share = busy[:, None]
    joints = JointTrajectories(
        share * stepping.angles + (1.0 - share) * standing.angles,
        share * stepping.contact + (1.0 - share),
        share * stepping.flat + (1.0 - share),
        gaussian_filter1d(turn, 0.15 * rate, mode="nearest") * busy,
    )
    joints["neck_rotation"][:] += 14.0 * joints.turn / PIVOT_RATE
    joints["lumbar_rotation"][:] += 7.0 * joints.turn / PIVOT_RATE
    return joints


def running(
    time: Array, rate: float, skeleton: SyntheticSkeleton, style: Style, rng: np.random.Generator
) -> JointTrajectories:
    """Return running straight ahead, with flight phases."""
    slowest, natural, fastest = RUNNING_SPEEDS
    speed = _checked_speed("running", style.speed, natural, (slowest, fastest))
    # approximate: with speed, runners increase step length more than cadence
    cadence = style.cadence or 140.0 + 9.0 * speed
    extent = _extent(RUNNING, style, skeleton, 60e3 * speed / cadence)
    return cycle(RUNNING, _phase(cadence, time, rate, style, rng), style, skeleton, extent)

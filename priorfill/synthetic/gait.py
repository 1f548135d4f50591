"""Walking, running, walking along a curve, and turning on the spot, as scores."""

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
"""Step length over cadence (m per step/min) in natural walking: Sekiya and Nagasaki, Gait
and Posture 7 (1998), for a height of 1.75 m."""

WALKING_SPEEDS = 0.6, 1.25, 2.1
"""Slowest, natural and fastest (m/s)."""

TURNING_SPEED = 1.1
"""Natural speed along a curve (m/s)."""

RUNNING_SPEEDS = 2.2, 3.2, 4.5
"""Slowest, natural ([N98] in `curves`) and fastest (m/s)."""

PIVOT_RATE = 75.0
"""Greatest rate of turning on the spot (degrees/s)."""

CONTACT_EDGE = 0.008
"""Part of the cycle in which a foot takes and gives up weight (scale of a sigmoid)."""

CADENCE_SD = 0.015
"""Variation of the cadence from cycle to cycle: 1 to 3 % in healthy walking (Hausdorff,
J. NeuroEngineering and Rehabilitation 2, 2005)."""

KNEE_SHARE, PELVIS_SHARE = 0.35, 0.8
"""How far knee flexion and pelvis rotation grow with the hips' range when speed does."""


def _window(phase: Array, start: float, end: float, edge: float) -> Array:
    """Return 1 between two phases and 0 elsewhere, with sigmoid edges."""
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    distance = np.abs(np.mod(phase - middle + 0.5, 1.0) - 0.5)
    return np.asarray(1.0 / (1.0 + np.exp(np.clip((distance - half) / edge, -50.0, 50.0))))


def cycle(
    curves: GaitCurves, phase: Array, style: Style, skeleton: SyntheticSkeleton, extent: float
) -> JointTrajectories:
    """Return the score of a gait.

    Parameters
    ----------
    curves : GaitCurves
        The gait.
    phase : ndarray [shape=(frames,), cycles]
        Of the left leg.
    style : Style
        Arm swing, step width, toe-out, lean.
    skeleton : SyntheticSkeleton
        For the angles that the step width takes.
    extent : float
        Factor on the range of the hips: the length of the steps.
    """
    score = stand(len(phase), style)
    turn = 2.0 * np.pi * phase
    share = 1.0 + PELVIS_SHARE * (extent - 1.0)
    rotation = -curves.pelvis_rotation * share * np.cos(turn)
    # the pelvis drops on the side that swings
    drop = curves.pelvis_list * np.cos(turn - 2.0 * np.pi * 0.24)
    thorax = curves.thorax_rotation * np.cos(turn)
    nod = 1.0 * np.cos(2.0 * turn - 0.6)
    score["pelvis_tilt"][:] = curves.pelvis_tilt
    score["pelvis_list"][:] = drop
    score["pelvis_rotation"][:] = rotation
    score["lumbar_flexion"][:] = curves.trunk_lean + style.lean + nod
    score["lumbar_side"][:] = -0.8 * drop
    score["lumbar_rotation"][:] = thorax - rotation
    # the head keeps looking ahead
    score["neck_flexion"][:] = -0.7 * (nod + curves.trunk_lean + style.lean) - curves.pelvis_tilt
    score["neck_side"][:] = -0.15 * drop
    score["neck_rotation"][:] = -0.85 * thorax

    hip_half = float(abs(skeleton.offsets["lthigh"][1]))
    inwards = np.arcsin((hip_half - 0.5 * style.step_width) / (skeleton.thigh + skeleton.shank))
    middle = 0.5 * (
        curves.hip(np.linspace(0, 1, 200)).max() + curves.hip(np.linspace(0, 1, 200)).min()
    )
    swing = style.arm_swing
    for side, (name, sign) in enumerate(zip(SIDES, (1.0, -1.0), strict=True)):
        own = phase + 0.5 * side
        score[f"{name}hip_flexion"][:] = middle + extent * (curves.hip(own) - middle)
        score[f"{name}hip_adduction"][:] = (
            np.rad2deg(inwards) + sign * drop + curves.sway * np.cos(2.0 * np.pi * (own - 0.31))
        )
        score[f"{name}hip_rotation"][:] = 0.9 * sign * rotation
        score[f"{name}knee_flexion"][:] = curves.knee(own) * (1.0 + KNEE_SHARE * (extent - 1.0))
        score[f"{name}ankle_dorsiflexion"][:] = curves.ankle(own)
        # the arm goes back as the leg of its side goes forwards
        back = np.cos(2.0 * np.pi * (own - 0.02))
        score[f"{name}shoulder_flexion"][:] = curves.shoulder[0] - swing * curves.shoulder[1] * back
        score[f"{name}elbow_flexion"][:] = curves.elbow[0] - swing * curves.elbow[1] * np.cos(
            2.0 * np.pi * (own - 0.06)
        )
        score[f"{name}shoulder_abduction"][:] = curves.shoulder_abduction + 2.0 * swing * back
        score[f"{name}shoulder_rotation"][:] = curves.shoulder_rotation - 6.0 * swing * back
        score[f"{name}clavicle_protraction"][:] = -2.5 * swing * back
        score[f"{name}wrist_flexion"][:] = 6.0 + 4.0 * swing * np.cos(2.0 * np.pi * (own - 0.15))
        score.contact[:, side] = _window(own, 0.0, curves.toe_off, CONTACT_EDGE)
        score.flat[:, side] = _window(own, *curves.flat, 0.015)
    return score


def _extent(curves: GaitCurves, style: Style, skeleton: SyntheticSkeleton, step: float) -> float:
    """Return the extent that makes steps of a given length (mm)."""
    samples = 100
    phase = np.arange(3 * samples) / samples

    def length(extent: float) -> float:
        score = cycle(curves, phase, style, skeleton, extent)
        # a frame of this score is 1/samples of a cycle, taken as a second
        velocity = root_velocity(score, skeleton, rate=float(samples))
        return float(velocity[samples : 2 * samples, 0].mean()) / 2.0

    low, high = 0.35, 1.9
    at_low, at_high = length(low), length(high)
    if not at_low <= step <= at_high:
        raise OptionError(
            f"steps of {step:.0f} mm are out of reach for this body ({at_low:.0f} to "
            f"{at_high:.0f} mm); change the speed or the cadence"
        )
    for _ in range(6):  # false position: the length is all but linear in the extent
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
            f"a speed of {speed:g} m/s is not for {motion}; give a value from "
            f"{range_[0]:g} to {range_[1]:g}"
        )
    return speed


def _walk(
    motion: str, natural: float, time: Array, rate: float, skeleton: SyntheticSkeleton,
    style: Style, rng: np.random.Generator,
) -> JointTrajectories:  # fmt: skip
    slowest, _, fastest = WALKING_SPEEDS
    speed = _checked_speed(motion, style.speed, natural, (slowest, fastest))
    # step length = ratio * cadence and speed = step length * cadence / 60; both lengths grow
    # with the leg
    size = (skeleton.thigh + skeleton.shank) / 859.0
    cadence = style.cadence or float(np.sqrt(60.0 * speed / (WALK_RATIO * size)))
    extent = _extent(WALKING, style, skeleton, 60e3 * speed / cadence)
    return cycle(WALKING, _phase(cadence, time, rate, style, rng), style, skeleton, extent)


def walking(
    time: Array, rate: float, skeleton: SyntheticSkeleton, style: Style, rng: np.random.Generator
) -> JointTrajectories:
    """Walk straight on."""
    return _walk("walking", WALKING_SPEEDS[1], time, rate, skeleton, style, rng)


def turning(
    time: Array, rate: float, skeleton: SyntheticSkeleton, style: Style, rng: np.random.Generator
) -> JointTrajectories:
    """Walk along a serpentine: curves to one side and to the other, some 4 s each."""
    score = _walk("turning", TURNING_SPEED, time, rate, skeleton, style, rng)
    wave = np.sin(2.0 * np.pi * (time / 8.0 + rng.uniform(0.0, 0.5)))
    bend = np.tanh(2.5 * wave)
    score.turn[:] = style.turn_rate * bend
    # head first, then the trunk, and the body leans into the curve
    ahead = bend * style.turn_rate / 35.0
    score["neck_rotation"][:] += 9.0 * ahead
    score["lumbar_rotation"][:] += 4.0 * ahead
    score["lumbar_side"][:] -= 2.0 * ahead
    return score


def pivoting(
    time: Array, rate: float, skeleton: SyntheticSkeleton, style: Style, rng: np.random.Generator
) -> JointTrajectories:
    """Turn about on the spot, stepping; to one side, a pause, and back."""
    cadence = style.cadence or 105.0
    stepping = cycle(STEPPING, _phase(cadence, time, rate, style, rng), style, skeleton, 1.0)
    standing = stand(len(time), style)
    wave = np.sin(2.0 * np.pi * (time / 6.0 + rng.uniform(0.0, 0.5)))
    turn = PIVOT_RATE * np.tanh(3.0 * wave) * np.abs(wave) ** 0.5
    busy = gaussian_filter1d((np.abs(wave) > 0.25).astype(np.float64), 0.12 * rate, mode="nearest")
    share = busy[:, None]
    score = JointTrajectories(
        share * stepping.angles + (1.0 - share) * standing.angles,
        share * stepping.contact + (1.0 - share),
        share * stepping.flat + (1.0 - share),
        gaussian_filter1d(turn, 0.15 * rate, mode="nearest") * busy,
    )
    score["neck_rotation"][:] += 14.0 * score.turn / PIVOT_RATE
    score["lumbar_rotation"][:] += 7.0 * score.turn / PIVOT_RATE
    return score


def running(
    time: Array, rate: float, skeleton: SyntheticSkeleton, style: Style, rng: np.random.Generator
) -> JointTrajectories:
    """Run straight on, with a flight between the steps."""
    slowest, natural, fastest = RUNNING_SPEEDS
    speed = _checked_speed("running", style.speed, natural, (slowest, fastest))
    # runners lengthen their steps more than they quicken them; approximate
    cadence = style.cadence or 140.0 + 9.0 * speed
    extent = _extent(RUNNING, style, skeleton, 60e3 * speed / cadence)
    return cycle(RUNNING, _phase(cadence, time, rate, style, rng), style, skeleton, extent)

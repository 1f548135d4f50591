"""From joint angles to a body on the floor, with stance feet that do not move.

The published curves describe the joints, not the path of the body. It follows from the feet: the
lowest point of a stance foot does not move, so the velocity of the pelvis is the negative of the
velocity of that point relative to the pelvis. Mean curves are not exactly consistent for one body,
so remaining sliding and penetration of the floor are removed by moving each foot slightly and
solving its leg again (`kinematics.solve_leg`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d

from priorfill.synthetic.kinematics import (
    JointTrajectories,
    Segments,
    align,
    leg,
    pelvis_rotation,
    rot_z,
    solve_leg,
    upper_body,
)
from priorfill.synthetic.synthetic_body import SIDES, SyntheticSkeleton

__all__ = ["ground", "root_velocity"]

Array = NDArray[np.float64]

ROLL_SOFTNESS = 5.0
"""mm. Height over which the floor contact moves from heel to ball."""

ROOT_SMOOTHING = 0.025
"""s. Standard deviation of the Gaussian that smooths velocity and height of the pelvis."""

OFFSET_SMOOTHING = 0.02
"""s. Standard deviation of the Gaussian that smooths the correction of a foot."""

MIN_STANCE_CONTACT = 0.5
"""Contact above which a foot is in stance."""

MIN_PHASE_SECONDS = 0.18
"""s. Shortest duration of a swing or a stance; in fast running a stance takes 0.2 s."""

MAX_EXIT_SPEED = 150.0
"""mm/s. Largest speed of the correction of a foot at the start and the end of a stance."""

CLEARANCE = 12.0
"""mm. Smallest height of the sole of a swing foot: the minimum toe clearance in walking is 10 to 20
mm (Winter 1991)."""

SWING_EDGE = 0.12
"""s. Total duration of the ramps of the clearance at both ends of a swing."""

MAX_REACH = 0.9985
"""Largest distance between hip and ankle, relative to the leg's length: the knee stays flexed by
about 4 degrees."""

MAX_SWING_OVERREACH = 6.0
"""mm. How far the target of a swing foot may be out of reach before the pelvis is lowered."""

REACH_WINDOW = 0.12
"""s. Duration in which the pelvis is lowered for a leg that would be too short."""

GRAVITY = 9810.0
"""mm/s². Gravitational acceleration."""


def _feet(joints: JointTrajectories, skeleton: SyntheticSkeleton, pelvis: Array) -> list[Segments]:
    origin = np.zeros((len(pelvis), 3))
    legs = [leg(joints, side, skeleton, origin, pelvis) for side in (0, 1)]
    up = np.broadcast_to([0.0, 0.0, 1.0], origin.shape)
    for side, name in enumerate(SIDES):
        ankle, foot = legs[side][f"{name}foot"]
        level = align(foot[:, :, 2], up, joints.flat[:, side])
        legs[side][f"{name}foot"] = ankle, level @ foot
    return legs


def _sole(ankle: Array, foot: Array, skeleton: SyntheticSkeleton) -> tuple[Array, Array]:
    """Return heel and ball [shape=(frames, 2, 3)], and the weight of each as the lower one."""
    points = ankle[:, None] + np.einsum("fij,kj->fki", foot, skeleton.sole)
    lower = 1.0 / (1.0 + np.exp(np.clip(np.diff(points[..., 2]) / ROLL_SOFTNESS, -50, 50)))
    return points, np.concatenate([1.0 - lower, lower], axis=1)


def _load(joints: JointTrajectories) -> tuple[Array, NDArray[np.bool_]]:
    total = joints.contact.sum(axis=1)
    return joints.contact / np.maximum(total, 1e-6)[:, None], total >= MIN_STANCE_CONTACT


def _velocity(
    joints: JointTrajectories,
    feet: list[tuple[Array, Array]],
    skeleton: SyntheticSkeleton,
    rate: float,
) -> Array:
    """Return the pelvis' horizontal velocity [shape=(frames, 2), mm/s] from the feet's."""
    weight, in_stance = _load(joints)
    velocity = np.zeros((len(weight), 2))
    for side, (ankle, foot) in enumerate(feet):
        points, lowest = _sole(ankle, foot, skeleton)
        moving = np.gradient(points[..., :2], 1.0 / rate, axis=0)
        velocity -= weight[:, side, None] * np.einsum("fk,fkc->fc", lowest, moving)
    if not in_stance.all():  # in flight the velocity is interpolated
        frames = np.arange(len(weight))
        for axis in (0, 1):
            velocity[:, axis] = np.interp(frames, frames[in_stance], velocity[in_stance, axis])
    return np.asarray(gaussian_filter1d(velocity, ROOT_SMOOTHING * rate, axis=0, mode="nearest"))


def root_velocity(joints: JointTrajectories, skeleton: SyntheticSkeleton, rate: float) -> Array:
    """Return the velocity [shape=(frames, 2), mm/s] of the pelvis for some joint trajectories.

    The heading is constant, with x forwards.
    """
    pelvis = pelvis_rotation(joints, np.zeros(len(joints.angles)))
    legs = _feet(joints, skeleton, pelvis)
    feet = [legs[side][f"{name}foot"] for side, name in enumerate(SIDES)]
    return _velocity(joints, feet, skeleton, rate)


def _height(
    joints: JointTrajectories,
    feet: list[tuple[Array, Array]],
    skeleton: SyntheticSkeleton,
    rate: float,
) -> Array:
    """Return the pelvis' height [shape=(frames,), mm] above the floor."""
    weight, in_stance = _load(joints)
    height = np.zeros(len(weight))
    for side, (ankle, foot) in enumerate(feet):
        points, lowest = _sole(ankle, foot, skeleton)
        height -= weight[:, side] * np.einsum("fk,fk->f", lowest, points[..., 2])
    if not in_stance.all():
        frames = np.arange(len(weight))
        last = np.maximum.accumulate(np.where(in_stance, frames, 0))
        following = np.minimum.accumulate(np.where(in_stance, frames, frames[-1])[::-1])[::-1]
        height = np.interp(frames, frames[in_stance], height[in_stance])
        # between take-off and landing the body is in free fall
        height += 0.5 * GRAVITY * (frames - last) * (following - frames) / rate**2
    return np.asarray(gaussian_filter1d(height, ROOT_SMOOTHING * rate, mode="nearest"))


def _interpolate_held(values: Array, slopes: Array, held: NDArray[np.bool_]) -> Array:
    """Interpolate values [shape=(frames, n)] smoothly between the frames in which they are held.

    Before the first and after the last held frame they are constant.
    """
    frames = np.flatnonzero(held)
    if not len(frames):
        return np.zeros_like(values)
    spline = CubicHermiteSpline(frames, values[frames], slopes[frames], axis=0)
    where = np.clip(np.arange(len(held)), frames[0], frames[-1])
    return np.where(held[:, None], values, spline(where))


def _stances(held: NDArray[np.bool_]) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], held, [False]]).astype(np.int8)))
    return [slice(a, b) for a, b in edges.reshape(-1, 2)]


def _with_minimum_duration(held: NDArray[np.bool_], rate: float) -> NDArray[np.bool_]:
    """Return stances and swings with a minimum duration, which some lack where motions are blended.

    Short swings are extended, because the foot would otherwise lag behind the body; then short
    stances are removed.
    """
    shortest = round(MIN_PHASE_SECONDS * rate)
    steady = held.copy()
    for swing in _stances(~held):
        lacking = max(0, shortest - (swing.stop - swing.start))
        steady[max(0, swing.start - lacking // 2) : swing.stop + lacking // 2] = False
    for stance in _stances(steady.copy()):
        inner = stance.start > 0 and stance.stop < len(held)
        if inner and stance.stop - stance.start < shortest:
            steady[stance] = False
    return steady


def _held_offset(values: Array, held: NDArray[np.bool_], limit: float = np.inf) -> Array:
    """Return offsets that make values [shape=(frames, n)] constant in every stance.

    They are interpolated between stances; a limit on their slope at the edges (change per frame)
    prevents overshoot.
    """
    offset, slope = np.zeros_like(values), np.zeros_like(values)
    for stance in _stances(held):
        offset[stance] = values[stance].mean(axis=0) - values[stance]
        if stance.stop - stance.start > 1:
            slope[stance] = np.clip(np.gradient(offset[stance], axis=0), -limit, limit)
    return _interpolate_held(offset, slope, held)


def _fix_stance(
    ankle: Array, foot: Array, skeleton: SyntheticSkeleton, held: NDArray[np.bool_], rate: float
) -> tuple[Array, Array, Array]:
    """Return the corrected ankle and foot of a stance foot, and its rotation (degrees)."""
    lateral = foot[:, :, 1]  # the heading of the foot is undefined where the toes point down
    yaw = np.zeros(len(held))
    for stance in _stances(held):
        yaw[stance] = np.unwrap(np.arctan2(-lateral[stance, 0], lateral[stance, 1]))
    turned = np.rad2deg(_held_offset(yaw[:, None], held)[:, 0])
    foot = rot_z(turned) @ foot
    points, lowest = _sole(ankle, foot, skeleton)

    moving = np.gradient(points[..., :2], axis=0)
    slid = np.cumsum(np.einsum("fk,fkc->fc", lowest, moving), axis=0)
    offset = np.zeros_like(ankle)
    offset[:, :2] = _held_offset(slid, held, limit=MAX_EXIT_SPEED / rate)

    sole = np.einsum("fk,fk->f", lowest, points[..., 2])[:, None]
    lift = np.where(held[:, None], -sole, 0.0)
    slope = np.gradient(lift, axis=0)
    # at the ends of a stance the gradient would include the swing
    edge = held & ~(np.roll(held, 1) & np.roll(held, -1))
    slope[edge] = 0.0
    lift = _interpolate_held(lift, slope, held)
    low = (sole + lift)[:, 0]
    # a smooth maximum; the clearance increases from 0 at the ends of the swing
    swings = minimum_filter1d(np.where(held, 0.0, CLEARANCE), max(1, round(SWING_EDGE * rate)))
    short = gaussian_filter1d(swings, SWING_EDGE * rate / 6.0, mode="nearest") - low
    offset[:, 2] = lift[:, 0] + np.where(held, 0.0, 0.5 * (short + np.hypot(short, 4.0)) - 2.0)
    # at the ends of a stance, a millimetre of sliding is better than a jerk of the knee
    offset = gaussian_filter1d(offset, OFFSET_SMOOTHING * rate, axis=0, mode="nearest")
    return ankle + offset, foot, turned


def ground(joints: JointTrajectories, skeleton: SyntheticSkeleton, rate: float) -> Segments:
    """Place a motion on the floor.

    Parameters
    ----------
    joints : JointTrajectories
        Joint angles and foot contacts.
    skeleton : SyntheticSkeleton
        The body.
    rate : float
        Frames per second (Hz).

    Returns
    -------
    segments : dict
        All segments, with z = 0 at the floor, starting at the origin with heading +x. The soles of
        stance feet do not move; the angles of the legs differ from the given ones accordingly.
    """
    heading = np.concatenate([[0.0], np.cumsum(joints.turn[1:] + joints.turn[:-1]) / (2.0 * rate)])
    pelvis = pelvis_rotation(joints, heading)
    legs = _feet(joints, skeleton, pelvis)
    feet = [legs[side][f"{name}foot"] for side, name in enumerate(SIDES)]
    held = np.stack(
        [_with_minimum_duration(c > MIN_STANCE_CONTACT, rate) for c in joints.contact.T], axis=1
    )

    velocity = _velocity(joints, feet, skeleton, rate)
    origin = np.empty((len(pelvis), 3))
    origin[:, :2] = np.cumsum(velocity, axis=0) / rate
    origin[:, :2] -= origin[0, :2].copy()
    origin[:, 2] = _height(joints, feet, skeleton, rate)

    fixed = [
        _fix_stance(origin + ankle, foot, skeleton, held[:, side], rate)
        for side, (ankle, foot) in enumerate(feet)
    ]
    hips = [legs[side][f"{name}thigh"][0] for side, name in enumerate(SIDES)]
    ankles = [ankle for ankle, _, _ in fixed]
    origin[:, 2] -= _lowering(origin, hips, ankles, held, skeleton, rate)

    segments = upper_body(joints, skeleton, origin, pelvis)
    for side, name in enumerate(SIDES):
        ankle, foot, turned = fixed[side]
        hip, thigh = legs[side][f"{name}thigh"]
        hip = origin + hip
        # the rotation of the stance foot is shared between hip and ankle
        thigh = rot_z(0.5 * turned) @ thigh
        thigh, knee, shank = solve_leg(hip, thigh, ankle, skeleton)
        segments |= {
            f"{name}thigh": (hip, thigh),
            f"{name}shank": (knee, shank),
            # from the shank, so that segment lengths are exact where the target is out of reach
            f"{name}foot": (
                knee + np.einsum("fij,j->fi", shank, skeleton.offsets[f"{name}foot"]),
                foot,
            ),
        }
    return segments


def _lowering(
    origin: Array,
    hips: list[Array],
    ankles: list[Array],
    held: NDArray[np.bool_],
    skeleton: SyntheticSkeleton,
    rate: float,
) -> Array:
    """Return the lowering of the pelvis [shape=(frames,), mm] for stance legs to reach."""
    length = MAX_REACH * (skeleton.thigh + skeleton.shank)
    down = np.zeros(len(origin))
    for side, (hip, ankle) in enumerate(zip(hips, ankles, strict=True)):
        towards = origin + hip - ankle
        level = np.minimum(np.linalg.norm(towards[:, :2], axis=1), length)
        short = towards[:, 2] - np.sqrt(length**2 - level**2)
        down = np.maximum(down, short - np.where(held[:, side], 0.0, MAX_SWING_OVERREACH))
    window = max(1, round(REACH_WINDOW * rate))
    widest = maximum_filter1d(down, window, mode="nearest")
    return np.asarray(gaussian_filter1d(widest, window / 4.0, mode="nearest"))

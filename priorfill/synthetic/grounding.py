"""From joint angles to a body on the floor: the feet that bear weight stand still.

The published curves say how the joints move, not where the body goes. It follows from the
feet: the point of a bearing foot that is lowest does not move, so the pelvis moves by the
opposite of what that point does seen from the pelvis. The mean curves of a group do not
close exactly for one body, so what is left of sliding and of penetrating the floor is taken
out by moving each foot a little and solving its leg again (`kinematics.solve_leg`).
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
"""Height (mm) over which the floor contact passes from heel to ball."""

ROOT_SMOOTHING = 0.025
"""Standard deviation (s) of the Gaussian that smooths the pelvis' velocity and height."""

OFFSET_SMOOTHING = 0.02
"""Standard deviation (s) of the Gaussian that smooths the correction of a foot."""

BEARING = 0.5
"""Contact above which a foot stands still."""

SHORTEST = 0.18
"""Shortest duration (s) of a swing or a stance; in fast running a stance takes 0.2."""

EXIT_SPEED = 150.0
"""Speed (mm/s) with which the correction of a stance may go on into the swing."""

CLEARANCE = 12.0
"""Height (mm) of the sole that a swinging foot keeps: the least toe clearance in walking is
10 to 20 mm (Winter 1991)."""

SWING_EDGE = 0.12
"""Time (s) in all in which the clearance comes and goes at the ends of a swing."""

REACH = 0.9985
"""Part of the leg's length that is used: a knee always stays bent by some 4 degrees."""

SWING_SHORT = 6.0
"""By how much (mm) a leg in swing may be too short before the pelvis makes way."""

REACH_WINDOW = 0.12
"""Time (s) in which the pelvis makes way for a leg that would be too short."""

GRAVITY = 9810.0
"""mm/s²."""


def _feet(score: JointTrajectories, skeleton: SyntheticSkeleton, pelvis: Array) -> list[Segments]:
    origin = np.zeros((len(pelvis), 3))
    legs = [leg(score, side, skeleton, origin, pelvis) for side in (0, 1)]
    up = np.broadcast_to([0.0, 0.0, 1.0], origin.shape)
    for side, name in enumerate(SIDES):
        ankle, foot = legs[side][f"{name}foot"]
        level = align(foot[:, :, 2], up, score.flat[:, side])
        legs[side][f"{name}foot"] = ankle, level @ foot
    return legs


def _sole(ankle: Array, foot: Array, skeleton: SyntheticSkeleton) -> tuple[Array, Array]:
    """Return heel and ball [shape=(frames, 2, 3)], and how far each is the lower one."""
    points = ankle[:, None] + np.einsum("fij,kj->fki", foot, skeleton.sole)
    lower = 1.0 / (1.0 + np.exp(np.clip(np.diff(points[..., 2]) / ROLL_SOFTNESS, -50, 50)))
    return points, np.concatenate([1.0 - lower, lower], axis=1)


def _bearing(score: JointTrajectories) -> tuple[Array, NDArray[np.bool_]]:
    total = score.contact.sum(axis=1)
    return score.contact / np.maximum(total, 1e-6)[:, None], total >= BEARING


def _velocity(
    score: JointTrajectories,
    feet: list[tuple[Array, Array]],
    skeleton: SyntheticSkeleton,
    rate: float,
) -> Array:
    """Return the pelvis' horizontal velocity [shape=(frames, 2), mm/s] from the feet's."""
    weight, bears = _bearing(score)
    velocity = np.zeros((len(weight), 2))
    for side, (ankle, foot) in enumerate(feet):
        points, lowest = _sole(ankle, foot, skeleton)
        moving = np.gradient(points[..., :2], 1.0 / rate, axis=0)
        velocity -= weight[:, side, None] * np.einsum("fk,fkc->fc", lowest, moving)
    if not bears.all():  # in flight the velocity goes on
        frames = np.arange(len(weight))
        for axis in (0, 1):
            velocity[:, axis] = np.interp(frames, frames[bears], velocity[bears, axis])
    return np.asarray(gaussian_filter1d(velocity, ROOT_SMOOTHING * rate, axis=0, mode="nearest"))


def root_velocity(score: JointTrajectories, skeleton: SyntheticSkeleton, rate: float) -> Array:
    """Return the velocity [shape=(frames, 2), mm/s] with which a score moves the pelvis.

    The heading is taken as constant, x forwards.
    """
    pelvis = pelvis_rotation(score, np.zeros(len(score.angles)))
    legs = _feet(score, skeleton, pelvis)
    feet = [legs[side][f"{name}foot"] for side, name in enumerate(SIDES)]
    return _velocity(score, feet, skeleton, rate)


def _height(
    score: JointTrajectories,
    feet: list[tuple[Array, Array]],
    skeleton: SyntheticSkeleton,
    rate: float,
) -> Array:
    """Return the pelvis' height [shape=(frames,), mm] above the floor."""
    weight, bears = _bearing(score)
    height = np.zeros(len(weight))
    for side, (ankle, foot) in enumerate(feet):
        points, lowest = _sole(ankle, foot, skeleton)
        height -= weight[:, side] * np.einsum("fk,fk->f", lowest, points[..., 2])
    if not bears.all():
        frames = np.arange(len(weight))
        last = np.maximum.accumulate(np.where(bears, frames, 0))
        following = np.minimum.accumulate(np.where(bears, frames, frames[-1])[::-1])[::-1]
        height = np.interp(frames, frames[bears], height[bears])
        # between take-off and landing the body is thrown
        height += 0.5 * GRAVITY * (frames - last) * (following - frames) / rate**2
    return np.asarray(gaussian_filter1d(height, ROOT_SMOOTHING * rate, mode="nearest"))


def _bridge(values: Array, slopes: Array, held: NDArray[np.bool_]) -> Array:
    """Carry values [shape=(frames, n)] smoothly across the frames in which they do not hold.

    Before the first and after the last held frame they stay as they are there.
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


def _steady(held: NDArray[np.bool_], rate: float) -> NDArray[np.bool_]:
    """Give every swing and stance the time of a step: where motions are blended some have less.

    Short swings are lengthened, because a foot that was left behind holds the body back; what
    is then left of short stances is dropped.
    """
    shortest = round(SHORTEST * rate)
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
    """Return what makes values [shape=(frames, n)] constant in every stance, bridged between.

    A limit (change a frame) on how steeply a bridge begins and ends keeps it from swinging out.
    """
    offset, slope = np.zeros_like(values), np.zeros_like(values)
    for stance in _stances(held):
        offset[stance] = values[stance].mean(axis=0) - values[stance]
        if stance.stop - stance.start > 1:
            slope[stance] = np.clip(np.gradient(offset[stance], axis=0), -limit, limit)
    return _bridge(offset, slope, held)


def _plant(
    ankle: Array, foot: Array, skeleton: SyntheticSkeleton, held: NDArray[np.bool_], rate: float
) -> tuple[Array, Array, Array]:
    """Return ankle and foot that neither slide, turn nor sink, and the angle that was turned."""
    lateral = foot[:, :, 1]  # the foot's heading is ill-defined where the toes point down
    yaw = np.zeros(len(held))
    for stance in _stances(held):
        yaw[stance] = np.unwrap(np.arctan2(-lateral[stance, 0], lateral[stance, 1]))
    turned = np.rad2deg(_held_offset(yaw[:, None], held)[:, 0])
    foot = rot_z(turned) @ foot
    points, lowest = _sole(ankle, foot, skeleton)

    moving = np.gradient(points[..., :2], axis=0)
    slid = np.cumsum(np.einsum("fk,fkc->fc", lowest, moving), axis=0)
    offset = np.zeros_like(ankle)
    offset[:, :2] = _held_offset(slid, held, limit=EXIT_SPEED / rate)

    sole = np.einsum("fk,fk->f", lowest, points[..., 2])[:, None]
    lift = np.where(held[:, None], -sole, 0.0)
    slope = np.gradient(lift, axis=0)
    # at the ends of a stance the gradient would reach into the swing
    edge = held & ~(np.roll(held, 1) & np.roll(held, -1))
    slope[edge] = 0.0
    lift = _bridge(lift, slope, held)
    low = (sole + lift)[:, 0]
    # a smooth maximum: the clearance grows from 0 at the ends of the swing
    swings = minimum_filter1d(np.where(held, 0.0, CLEARANCE), max(1, round(SWING_EDGE * rate)))
    short = gaussian_filter1d(swings, SWING_EDGE * rate / 6.0, mode="nearest") - low
    offset[:, 2] = lift[:, 0] + np.where(held, 0.0, 0.5 * (short + np.hypot(short, 4.0)) - 2.0)
    # where a stance begins and ends, a millimetre of sliding is better than a jerk of the knee
    offset = gaussian_filter1d(offset, OFFSET_SMOOTHING * rate, axis=0, mode="nearest")
    return ankle + offset, foot, turned


def ground(score: JointTrajectories, skeleton: SyntheticSkeleton, rate: float) -> Segments:
    """Put a motion on the floor.

    Parameters
    ----------
    score : JointTrajectories
        The joints' angles and which foot bears.
    skeleton : SyntheticSkeleton
        The body.
    rate : float
        Frames per second (Hz).

    Returns
    -------
    segments : dict
        Every segment, in a world with z = 0 at the floor, beginning at the origin with
        heading +x. In stance the soles keep their place; the legs' angles differ from the
        score's as far as that needs.
    """
    heading = np.concatenate([[0.0], np.cumsum(score.turn[1:] + score.turn[:-1]) / (2.0 * rate)])
    pelvis = pelvis_rotation(score, heading)
    legs = _feet(score, skeleton, pelvis)
    feet = [legs[side][f"{name}foot"] for side, name in enumerate(SIDES)]
    held = np.stack([_steady(c > BEARING, rate) for c in score.contact.T], axis=1)

    velocity = _velocity(score, feet, skeleton, rate)
    origin = np.empty((len(pelvis), 3))
    origin[:, :2] = np.cumsum(velocity, axis=0) / rate
    origin[:, :2] -= origin[0, :2].copy()
    origin[:, 2] = _height(score, feet, skeleton, rate)

    planted = [
        _plant(origin + ankle, foot, skeleton, held[:, side], rate)
        for side, (ankle, foot) in enumerate(feet)
    ]
    hips = [legs[side][f"{name}thigh"][0] for side, name in enumerate(SIDES)]
    ankles = [ankle for ankle, _, _ in planted]
    origin[:, 2] -= _make_way(origin, hips, ankles, held, skeleton, rate)

    segments = upper_body(score, skeleton, origin, pelvis)
    for side, name in enumerate(SIDES):
        ankle, foot, turned = planted[side]
        hip, thigh = legs[side][f"{name}thigh"]
        hip = origin + hip
        # the turn of the planted foot is shared between hip and ankle
        thigh = rot_z(0.5 * turned) @ thigh
        thigh, knee, shank = solve_leg(hip, thigh, ankle, skeleton)
        segments |= {
            f"{name}thigh": (hip, thigh),
            f"{name}shank": (knee, shank),
            # from the shank down, so that segment lengths hold where the target was too far
            f"{name}foot": (
                knee + np.einsum("fij,j->fi", shank, skeleton.offsets[f"{name}foot"]),
                foot,
            ),
        }
    return segments


def _make_way(
    origin: Array,
    hips: list[Array],
    ankles: list[Array],
    held: NDArray[np.bool_],
    skeleton: SyntheticSkeleton,
    rate: float,
) -> Array:
    """Return by how much [shape=(frames,), mm] the pelvis goes down for bearing legs to reach."""
    length = REACH * (skeleton.thigh + skeleton.shank)
    down = np.zeros(len(origin))
    for side, (hip, ankle) in enumerate(zip(hips, ankles, strict=True)):
        towards = origin + hip - ankle
        level = np.minimum(np.linalg.norm(towards[:, :2], axis=1), length)
        short = towards[:, 2] - np.sqrt(length**2 - level**2)
        down = np.maximum(down, short - np.where(held[:, side], 0.0, SWING_SHORT))
    window = max(1, round(REACH_WINDOW * rate))
    widest = maximum_filter1d(down, window, mode="nearest")
    return np.asarray(gaussian_filter1d(widest, window / 4.0, mode="nearest"))

"""Rotations, forward kinematics of the body, and inverse kinematics of the legs.

Axes are x forwards, y left, z up, in the upright pose. All functions are vectorised over frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.synthetic.synthetic_body import MARKER_SEGMENTS, SIDES, SyntheticSkeleton

__all__ = [
    "CHANNELS",
    "JointTrajectories",
    "Segments",
    "align",
    "leg",
    "marker_positions",
    "pelvis_rotation",
    "rot_x",
    "rot_y",
    "rot_z",
    "solve_leg",
    "upper_body",
]

Array = NDArray[np.float64]
Segments = dict[str, tuple[Array, Array]]
"""Segment to its proximal joint [shape=(frames, 3), mm] and axes [shape=(frames, 3, 3)]."""

REACH_SMOOTHING = 0.003
"""Share of the leg's length over which the limit of its reach is smoothed."""

MIN_REACH = 0.3
"""Smallest distance between hip and ankle, relative to the leg's length."""

_AXIAL = (
    "pelvis_tilt", "pelvis_list", "pelvis_rotation", "lumbar_flexion", "lumbar_side",
    "lumbar_rotation", "neck_flexion", "neck_side", "neck_rotation",
)  # fmt: skip
_LIMB = (
    "hip_flexion", "hip_adduction", "hip_rotation", "knee_flexion", "ankle_dorsiflexion",
    "foot_rotation", "clavicle_elevation", "clavicle_protraction", "shoulder_flexion",
    "shoulder_abduction", "shoulder_rotation", "elbow_flexion",
    "forearm_pronation", "wrist_flexion",
)  # fmt: skip

CHANNELS: tuple[str, ...] = _AXIAL + tuple(side + name for side in SIDES for name in _LIMB)
"""The joint angles of a `JointTrajectories`. Flexion is positive (trunk and pelvis: forwards);
list and side bending are positive where the left side goes up; rotations of trunk and head are
positive to the left, those of the limbs inwards."""

_COLUMN = {name: i for i, name in enumerate(CHANNELS)}


@dataclass(frozen=True)
class JointTrajectories:
    """Joint angles and foot contacts over time, before the body is placed on the floor.

    Attributes
    ----------
    angles : ndarray [shape=(frames, channels), degrees]
        By `CHANNELS`.
    contact : ndarray [shape=(frames, 2)]
        Load of the left and the right foot, 0 to 1.
    flat : ndarray [shape=(frames, 2)]
        How flat the sole is on the floor, 0 to 1.
    turn : ndarray [shape=(frames,), degrees/s]
        Change of heading, positive to the left.
    """

    angles: Array
    contact: Array
    flat: Array
    turn: Array

    @classmethod
    def standing(cls, frames: int) -> JointTrajectories:
        """Return trajectories with all angles 0, standing on both feet, to be modified."""
        return cls(
            np.zeros((frames, len(CHANNELS))),
            np.ones((frames, 2)),
            np.ones((frames, 2)),
            np.zeros(frames),
        )

    def __getitem__(self, channel: str) -> Array:
        """Return an angle [shape=(frames,), degrees] as a writable view."""
        view: Array = self.angles[:, _COLUMN[channel]]
        return view


def _rotation(degrees: Array, axis: int) -> Array:
    angle = np.deg2rad(degrees)
    cos, sin = np.cos(angle), np.sin(angle)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    out = np.zeros((*angle.shape, 3, 3))
    out[..., axis, axis] = 1.0
    out[..., first, first] = out[..., second, second] = cos
    out[..., first, second] = -sin
    out[..., second, first] = sin
    return out


def rot_x(degrees: Array) -> Array:
    """Return rotations [shape=(frames, 3, 3)] about x; positive angles raise the left side."""
    return _rotation(degrees, 0)


def rot_y(degrees: Array) -> Array:
    """Return rotations [shape=(frames, 3, 3)] about y; positive angles lean forwards."""
    return _rotation(degrees, 1)


def rot_z(degrees: Array) -> Array:
    """Return rotations [shape=(frames, 3, 3)] about z; positive angles turn to the left."""
    return _rotation(degrees, 2)


def _apply(rotation: Array, vector: Array) -> Array:
    return np.asarray(
        np.einsum("fij,j->fi" if vector.ndim == 1 else "fij,fj->fi", rotation, vector)
    )


def align(start: Array, end: Array, fraction: Array | float = 1.0) -> Array:
    """Return the smallest rotations from one direction to another, or a fraction of them.

    Parameters
    ----------
    start, end : ndarray [shape=(frames, 3)]
        Directions, of any length above 0.
    fraction : ndarray [shape=(frames,)] or float
        Fraction of the rotation, 0 to 1.

    Returns
    -------
    rotations : ndarray [shape=(frames, 3, 3)]
        By Rodrigues' formula; the identity for opposite directions, whose smallest rotation is not
        unique.
    """
    axis = np.cross(
        start / np.linalg.norm(start, axis=1, keepdims=True),
        end / np.linalg.norm(end, axis=1, keepdims=True),
    )
    sin = np.linalg.norm(axis, axis=1)
    angle = fraction * np.arctan2(
        sin, np.einsum("fi,fi->f", start, end) / np.linalg.norm(start, axis=1)
        / np.linalg.norm(end, axis=1),
    )  # fmt: skip
    axis = axis / np.maximum(sin, 1e-12)[:, None]
    cross = np.zeros((len(axis), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -axis[:, 2], axis[:, 1], -axis[:, 0]
    cross -= cross.transpose(0, 2, 1)
    sine, versine = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def pelvis_rotation(joints: JointTrajectories, heading: Array) -> Array:
    """Return the pelvis' axes [shape=(frames, 3, 3)] for a heading [shape=(frames,), degrees]."""
    yaw = rot_z(heading + joints["pelvis_rotation"])
    return yaw @ rot_x(joints["pelvis_list"]) @ rot_y(joints["pelvis_tilt"])


def leg(
    joints: JointTrajectories, side: int, skeleton: SyntheticSkeleton, origin: Array, pelvis: Array
) -> Segments:
    """Return thigh, shank and foot of one side, from the joint angles."""
    name, sign = SIDES[side], (1.0, -1.0)[side]
    thigh = (
        pelvis
        # hip flexion is relative to the vertical (see gait_curves), not to the pelvis
        @ rot_y(-joints[f"{name}hip_flexion"] - joints["pelvis_tilt"])
        @ rot_x(-sign * joints[f"{name}hip_adduction"])
        @ rot_z(-sign * joints[f"{name}hip_rotation"])
    )
    shank = thigh @ rot_y(joints[f"{name}knee_flexion"])
    foot = (
        shank
        @ rot_y(-joints[f"{name}ankle_dorsiflexion"])
        @ rot_z(-sign * joints[f"{name}foot_rotation"])
    )
    hip = origin + _apply(pelvis, skeleton.offsets[f"{name}thigh"])
    knee = hip + _apply(thigh, skeleton.offsets[f"{name}shank"])
    ankle = knee + _apply(shank, skeleton.offsets[f"{name}foot"])
    return {
        f"{name}thigh": (hip, thigh),
        f"{name}shank": (knee, shank),
        f"{name}foot": (ankle, foot),
    }


def solve_leg(
    hip: Array, thigh: Array, target: Array, skeleton: SyntheticSkeleton
) -> tuple[Array, Array, Array]:
    """Move an ankle to a target with the smallest change of the leg.

    Parameters
    ----------
    hip, target : ndarray [shape=(frames, 3), mm]
        Hip joint, and target of the ankle.
    thigh : ndarray [shape=(frames, 3, 3)]
        Axes of the thigh before, which determine the direction of the knee.
    skeleton : SyntheticSkeleton
        Lengths.

    Returns
    -------
    thigh : ndarray [shape=(frames, 3, 3)]
    knee : ndarray [shape=(frames, 3), mm]
    shank : ndarray [shape=(frames, 3, 3)]
        For a target out of reach the leg is straight.
    """
    upper, lower = skeleton.thigh, skeleton.shank
    towards = target - hip
    # a smooth minimum, since the derivative of the knee angle is unbounded at the straight leg
    spare = upper + lower - np.linalg.norm(towards, axis=1)
    spare = 0.5 * (spare + np.hypot(spare, REACH_SMOOTHING * (upper + lower)))
    distance = np.maximum(upper + lower - spare, MIN_REACH * (upper + lower))
    cos_inner = (upper**2 + lower**2 - distance**2) / (2.0 * upper * lower)
    flexion = 180.0 - np.rad2deg(np.arccos(np.clip(cos_inner, -1.0, 1.0)))
    bend = rot_y(flexion)
    down = np.array([0.0, 0.0, -1.0])
    straight = _apply(thigh, down) * upper + _apply(thigh @ bend, down) * lower
    thigh = align(straight, towards) @ thigh
    return thigh, hip + _apply(thigh, down) * upper, thigh @ bend


def upper_body(
    joints: JointTrajectories, skeleton: SyntheticSkeleton, origin: Array, pelvis: Array
) -> Segments:
    """Return pelvis, trunk, head and arms, from the joint angles."""
    segments: Segments = {"pelvis": (origin, pelvis)}
    base = origin + _apply(pelvis, skeleton.offsets["thorax"])
    thorax = (
        pelvis
        @ rot_z(joints["lumbar_rotation"])
        @ rot_x(joints["lumbar_side"])
        @ rot_y(joints["lumbar_flexion"])
    )
    segments["thorax"] = (base, thorax)
    head = (
        thorax @ rot_z(joints["neck_rotation"]) @ rot_x(joints["neck_side"])
        @ rot_y(joints["neck_flexion"])
    )  # fmt: skip
    segments["head"] = (base + _apply(thorax, skeleton.offsets["head"]), head)
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        parent = base, thorax
        for segment, axes in (
            (
                "clavicle",
                rot_z(-sign * joints[f"{side}clavicle_protraction"])
                @ rot_x(sign * joints[f"{side}clavicle_elevation"]),
            ),
            (
                "upperarm",
                rot_y(-joints[f"{side}shoulder_flexion"])
                @ rot_x(sign * joints[f"{side}shoulder_abduction"])
                @ rot_z(-sign * joints[f"{side}shoulder_rotation"]),
            ),
            (
                "forearm",
                rot_y(-joints[f"{side}elbow_flexion"])
                @ rot_z(-sign * joints[f"{side}forearm_pronation"]),
            ),
            # the palm faces inwards, so the wrist flexes towards the body
            ("hand", rot_x(-sign * joints[f"{side}wrist_flexion"])),
        ):
            joint = parent[0] + _apply(parent[1], skeleton.offsets[side + segment])
            parent = joint, parent[1] @ axes
            segments[side + segment] = parent
    return segments


def marker_positions(
    segments: Segments, skeleton: SyntheticSkeleton, displacement: Array | None = None
) -> Array:
    """Return the markers [shape=(frames, 41, 3), mm] on the segments.

    Parameters
    ----------
    segments : dict
        All segments.
    skeleton : SyntheticSkeleton
        Positions of the markers on the segments.
    displacement : ndarray [shape=(frames, 41, 3), mm] or None
        Soft-tissue displacement in the frame of each marker's segment.
    """
    frames = len(segments["pelvis"][0])
    out = np.empty((frames, len(MARKER_SEGMENTS), 3))
    for marker, segment in enumerate(MARKER_SEGMENTS):
        origin, axes = segments[segment]
        local = np.broadcast_to(skeleton.markers[marker], (frames, 3))
        if displacement is not None:
            local = local + displacement[:, marker]
        out[:, marker] = origin + _apply(axes, local)
    return out

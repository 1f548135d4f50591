"""A skeleton, its motion, and forward kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "JointPoses",
    "Skeleton",
    "SkeletonMotion",
    "euler_rotations",
    "forward_kinematics",
    "part_of_motion",
]

_AXES = "XYZ"


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Joints, each with the bone that begins in it.

    In the rest pose no joint is rotated, so that the frames of all bones have the axes of the
    world.

    Attributes
    ----------
    names : tuple of str
        The joints' names, parents before children; the first is a root.
    parents : tuple of int
        The number of each joint's parent; -1 for a root.
    offsets : ndarray [shape=(joints, 3), file units]
        From the parent to the joint, in the rest pose; 0 for a root.
    ends : ndarray [shape=(joints, 3), file units]
        From the joint to the end of its bone, in the rest pose.
    mm_per_unit : float or None
        Millimetres in a unit of length, if the file states it.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: NDArray[np.float64]
    ends: NDArray[np.float64]
    mm_per_unit: float | None = None


@dataclass(frozen=True, eq=False)
class SkeletonMotion:
    """The motion of a skeleton.

    Attributes
    ----------
    skeleton : Skeleton
        The skeleton.
    root : ndarray [shape=(frames, 3), file units]
        Position of the root.
    turns : dict of int to ndarray [shape=(frames, 3, 3)]
        Rotation of joints from the rest pose, in their parent's frame; other joints are not
        rotated.
    moves : dict of int to ndarray [shape=(frames, 3), file units]
        Offsets of joints that also translate, in place of the skeleton's; positions of further
        roots.
    rate : float or None
        Frames per second (Hz); None if the file does not state it.
    """

    skeleton: Skeleton
    root: NDArray[np.float64]
    turns: dict[int, NDArray[np.float64]]
    moves: dict[int, NDArray[np.float64]] = field(default_factory=dict)
    rate: float | None = None


@dataclass(frozen=True, eq=False)
class JointPoses:
    """Positions and rotations of a skeleton's joints in the world.

    Attributes
    ----------
    positions : ndarray [shape=(frames, joints, 3), file units]
        The joints.
    rotations : ndarray [shape=(frames, joints, 3, 3)]
        From the frame of each joint's bone to the world.
    """

    positions: NDArray[np.float64]
    rotations: NDArray[np.float64]


def part_of_motion(motion: SkeletonMotion, joints: Sequence[int]) -> SkeletonMotion:
    """Return the motion of some joints of a skeleton.

    Parameters
    ----------
    motion : SkeletonMotion
        The motion.
    joints : sequence of int
        The joints, in ascending order; the parent of each is among them, or it is a root.

    Returns
    -------
    SkeletonMotion
        With the joints in the same order.
    """
    skeleton, number = motion.skeleton, {joint: k for k, joint in enumerate(joints)}
    rows = np.array(joints)
    part = Skeleton(
        tuple(skeleton.names[joint] for joint in joints),
        tuple(number.get(skeleton.parents[joint], -1) for joint in joints),
        skeleton.offsets[rows],
        skeleton.ends[rows],
        skeleton.mm_per_unit,
    )
    turns = {number[joint]: turn for joint, turn in motion.turns.items() if joint in number}
    moves = {number[joint]: move for joint, move in motion.moves.items() if joint in number}
    root = motion.moves.get(joints[0], motion.root)
    return SkeletonMotion(part, root, turns, moves, motion.rate)


def euler_rotations(order: str, angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotations of intrinsic Euler angles.

    Parameters
    ----------
    order : str
        Axes, such as ``"ZXY"``: the rotation is the product of matrices in this order.
    angles : ndarray [shape=(..., axes), rad]
        One angle for each axis.

    Returns
    -------
    ndarray [shape=(..., 3, 3)]
        The identity if there is no axis.

    Examples
    --------
    >>> euler_rotations("Z", np.array([np.pi / 2])).round().astype(int).tolist()
    [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    """
    rotations = np.broadcast_to(np.eye(3), (*angles.shape[:-1], 3, 3))
    for column, axis in enumerate(order):
        rotations = rotations @ _axis_rotations(_AXES.index(axis), angles[..., column])
    return rotations


def _axis_rotations(axis: int, angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rotations about one axis."""
    second, third = (axis + 1) % 3, (axis + 2) % 3
    rotations = np.zeros((*angle.shape, 3, 3))
    rotations[..., axis, axis] = 1.0
    rotations[..., second, second] = rotations[..., third, third] = np.cos(angle)
    rotations[..., third, second] = np.sin(angle)
    rotations[..., second, third] = -rotations[..., third, second]
    return rotations


def forward_kinematics(motion: SkeletonMotion) -> JointPoses:
    """Compute positions and rotations of the joints.

    With the parent's position p and rotation R, a joint with offset o and own rotation T has the
    position p + R o and the rotation R T.

    Parameters
    ----------
    motion : SkeletonMotion
        The skeleton and its joint angles.
    """
    skeleton, frames = motion.skeleton, len(motion.root)
    positions = np.empty((frames, len(skeleton.names), 3))
    rotations = np.empty((*positions.shape, 3))
    for joint, parent in enumerate(skeleton.parents):
        if parent < 0:
            positions[:, joint] = motion.moves.get(joint, motion.root)
            above = np.broadcast_to(np.eye(3), (frames, 3, 3))
        else:
            above = rotations[:, parent]
            offset = motion.moves.get(joint, skeleton.offsets[joint])
            positions[:, joint] = positions[:, parent] + np.einsum(
                "...ij,...j->...i", above, offset
            )
        turn = motion.turns.get(joint)
        rotations[:, joint] = above if turn is None else above @ turn
    return JointPoses(positions, rotations)

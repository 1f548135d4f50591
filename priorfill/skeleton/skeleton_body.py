"""The body of a skeleton: its parts, with frames that are comparable between skeletons.

Kinds of skeletons differ in their bones, frames, and places of joints. They have anatomy in common,
and the rest pose, in which the body stands upright and looks ahead. Each part therefore gets a
frame in the rest pose, defined by the direction of its limb, and a size along each axis of that
frame. A position in the frame, in units of these sizes, is about the same on every body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import ClipError
from priorfill.skeleton.joints import JointPoses, Skeleton
from priorfill.skeleton.part_names import (
    FALLBACK_PARTS,
    PARTS,
    SIDES,
    find_joints,
)

__all__ = ["BodyPart", "SkeletonBody", "part_frames"]

WRIST_FRACTION = 2.0 / 3.0
"""Fraction of the forearm at which the part begins that rotates with the hand, as in ASF."""

_Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BodyPart:
    """A part of a body.

    Attributes
    ----------
    joint : int
        The joint with which it moves.
    origin : ndarray [shape=(3,), mm]
        The origin of its frame relative to that joint, in the rest pose.
    axes : ndarray [shape=(3, 3)]
        Its frame's axes as columns, in the rest pose: the body's axes (up, left, ahead), rotated
        by the smallest angle that aligns one of them with the limb.
    size : ndarray [shape=(3,), mm]
        The unit of length along each axis.
    """

    joint: int
    origin: _Vector
    axes: NDArray[np.float64]
    size: _Vector


class SkeletonBody:
    """The body of a skeleton.

    Parameters
    ----------
    skeleton : Skeleton
        The skeleton.
    file : str
        Name of the file for messages.
    mm_per_unit : float
        Millimetres in its unit of length.

    Attributes
    ----------
    kind : SkeletonKind
        The kind of skeleton.
    up, left, ahead : ndarray [shape=(3,)]
        Unit vectors of the rest pose.

    Raises
    ------
    ClipError
        If the skeleton is of no known kind, or its rest pose is not that of a body.
    """

    def __init__(self, skeleton: Skeleton, file: str, mm_per_unit: float = 1.0) -> None:
        self.kind, self._joints = find_joints(skeleton.names, skeleton.parents, file)
        self._skeleton, self._file = skeleton, file
        self._rest = skeleton.rest_positions() * mm_per_unit
        self._ends = self._rest + skeleton.ends * mm_per_unit
        up = self._midpoint("upper_arm") - self._midpoint("thigh")
        left = self._position("left_thigh") - self._position("right_thigh")
        lengths = np.array([self.leg, self.arm, np.linalg.norm(up), np.linalg.norm(left)])
        ahead = np.cross(left, up)
        if not np.isfinite(lengths).all() or min(lengths.min(), np.linalg.norm(ahead)) <= 0.0:
            raise ClipError(f"{file}: its limbs have no length in the rest pose; check the file")
        self.up = up / lengths[2]
        self.ahead = ahead / np.linalg.norm(ahead)
        self.left: _Vector = np.cross(self.up, self.ahead)

    def _position(self, part: str) -> _Vector:
        """Return the position of a part's joint in the rest pose (mm, from the root)."""
        position: _Vector = self._rest[self._joints[part]]
        return position

    def _midpoint(self, limb: str) -> _Vector:
        """Return the midpoint of the left and the right joint."""
        middle: _Vector = np.mean([self._position(f"{side}_{limb}") for side in SIDES], axis=0)
        return middle

    def _chain_length(self, *limbs: str) -> float:
        """Return the length from joint to joint (mm), averaged over both sides."""
        return float(
            sum(
                np.linalg.norm(self._position(f"{side}_{end}") - self._position(f"{side}_{start}"))
                for start, end in pairwise(limbs)
                for side in SIDES
            )
            / len(SIDES)
        )

    @property
    def leg(self) -> float:
        """Length from hip to ankle (mm)."""
        return self._chain_length("thigh", "shank", "foot")

    @property
    def arm(self) -> float:
        """Length from shoulder to wrist (mm)."""
        return self._chain_length("upper_arm", "forearm", "hand")

    @cached_property
    def size(self) -> float:
        """Size of the body (mm): lengths of leg, trunk and arm."""
        trunk = np.linalg.norm(self._midpoint("upper_arm") - self._midpoint("thigh"))
        return self.leg + float(trunk) + self.arm

    @cached_property
    def parts(self) -> dict[str, BodyPart]:
        """All parts; parts that the skeleton lacks move with their fallback."""
        parts = self._trunk_parts() | self._limb_parts()
        return {name: parts[name] for name in PARTS}

    def _trunk_parts(self) -> dict[str, BodyPart]:
        shoulders, hips = self._midpoint("upper_arm"), self._midpoint("thigh")
        width = np.linalg.norm(self._position("left_upper_arm") - self._position("right_upper_arm"))
        trunk = np.array([np.linalg.norm(shoulders - hips), float(width), self.size])
        isotropic = np.full(3, self.size)
        return {
            name: self._part(name, origin, self.up, size)
            for name, origin, size in (
                ("pelvis", hips, isotropic),
                ("thorax", shoulders, trunk),
                ("head", self._position("head"), isotropic),
                ("left_shoulder", shoulders, trunk),
                ("right_shoulder", shoulders, trunk),
            )
        }

    def _limb_parts(self) -> dict[str, BodyPart]:
        parts = {}
        isotropic = np.full(3, self.size)
        for side in SIDES:
            for limb, follows in (
                *(("upper_arm", "forearm"), ("forearm", "hand")),
                *(("thigh", "shank"), ("shank", "foot")),
            ):
                name = f"{side}_{limb}"
                along = self._position(f"{side}_{follows}") - self._position(name)
                size = np.array([np.linalg.norm(along), self.size, self.size])
                parts[name] = self._part(name, self._position(name), along, size)
            forearm, hand, foot = (f"{side}_{limb}" for limb in ("forearm", "hand", "foot"))
            elbow, wrist = self._position(forearm), self._position(hand)
            start = elbow + WRIST_FRACTION * (wrist - elbow)
            parts[f"{side}_wrist"] = self._part(
                f"{side}_wrist", start, wrist - elbow, parts[forearm].size
            )
            # kinds of skeletons end hands and feet at different points, which give no size
            along = self._ends[self._joints[hand]] - wrist
            parts[hand] = self._part(hand, wrist, along, isotropic)
            # nor do they agree on the slope of the foot's bone, but all stand on flat soles
            shank = self._position(foot) - self._position(f"{side}_shank")
            shank -= (shank @ self.ahead) * self.ahead
            parts[foot] = self._part(foot, self._position(foot), shank, isotropic)
        return parts

    def _part(self, name: str, origin: _Vector, along: _Vector, size: _Vector) -> BodyPart:
        """Return a part; ``size`` starts with that along the limb."""
        joint = self._joints.get(name)
        if joint is None:
            side, limb = name.split("_", 1)
            joint = self._joints[f"{side}_{FALLBACK_PARTS[limb]}"]
        if np.linalg.norm(along) == 0.0:  # a bone without an end continues its parent
            along = origin - self._rest[self._skeleton.parents[joint]]
        length = float(np.linalg.norm(along))
        if length == 0.0:
            raise ClipError(f"{self._file}: {name} has no length in the rest pose; check the file")
        direction = along / length
        # rotate the body's axes by the smallest angle that aligns one of them with the limb
        body = np.stack([self.up, self.left, self.ahead])
        cosines = body @ direction
        nearest = int(np.argmax(np.abs(cosines)))
        turn = _smallest_rotation(np.sign(cosines[nearest]) * body[nearest], direction)
        sizes = np.array(size[1:])
        return BodyPart(
            joint,
            origin - self._rest[joint],
            turn @ body.T,
            np.insert(sizes, nearest, size[0]),
        )


def _smallest_rotation(start: _Vector, end: _Vector) -> NDArray[np.float64]:
    """Return the smallest rotation of a unit vector to another less than 180 degrees away."""
    axis, cosine = np.cross(start, end), float(start @ end)
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    rotation: NDArray[np.float64] = np.eye(3) + cross + cross @ cross / (1.0 + cosine)
    return rotation


def part_frames(
    part: BodyPart, poses: JointPoses, mm_per_unit: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a part's frame in the world.

    Parameters
    ----------
    part : BodyPart
        The part.
    poses : JointPoses
        The joints of the motion.
    mm_per_unit : float
        Millimetres in its unit of length.

    Returns
    -------
    origin : ndarray [shape=(frames, 3), mm]
    axes : ndarray [shape=(frames, 3, 3), mm]
        As columns, with the part's sizes as lengths.
    """
    rotations = poses.rotations[:, part.joint]
    origin = poses.positions[:, part.joint] * mm_per_unit + rotations @ part.origin
    return origin, rotations @ (part.axes * part.size)

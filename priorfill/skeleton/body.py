"""The body of a skeleton: its parts, each with a frame of its own that fits other skeletons' too.

Skeletons of different kinds have other bones, other frames, and joints at other places. What
they have in common is anatomy in the rest pose, in which a body stands upright and looks ahead. So
each part gets a frame there, by where its limb points, and a size in each direction of that
frame. A place in it, in sizes, is about the same place on any body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import ClipError
from priorfill.skeleton.joints import Placed, Skeleton
from priorfill.skeleton.part_names import (
    BEFORE,
    PARTS,
    SIDES,
    find_joints,
)

__all__ = ["Body", "Part", "part_frames"]

WRIST = 2.0 / 3.0
"""Where on the forearm the lower part begins that turns with the hand, as ASF has it."""

_Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a body.

    Attributes
    ----------
    joint : int
        The joint with which it moves.
    origin : ndarray [shape=(3,), mm]
        The origin of its frame, from that joint, in the rest pose.
    axes : ndarray [shape=(3, 3)]
        Its frame's axes as columns, in the rest pose: the body's own (up, to the left, ahead),
        turned so far that one of them points along the limb.
    size : ndarray [shape=(3,), mm]
        What counts as one along each axis.
    """

    joint: int
    origin: _Vector
    axes: NDArray[np.float64]
    size: _Vector


class Body:
    """A skeleton's body.

    Parameters
    ----------
    skeleton : Skeleton
        The skeleton.
    file : str
        What to call it in messages.
    mm_per_unit : float
        Millimetres in its unit of length.

    Raises
    ------
    ClipError
        Where the skeleton is of no kind that is known, or no body stands in its rest pose.
    """

    def __init__(self, skeleton: Skeleton, file: str, mm_per_unit: float = 1.0) -> None:
        self.kind, self._joints = find_joints(skeleton.names, skeleton.parents, file)
        self._skeleton, self._file = skeleton, file
        self._rest = skeleton.rest() * mm_per_unit
        self._ends = self._rest + skeleton.ends * mm_per_unit
        up = self._middle("upper_arm") - self._middle("thigh")
        left = self._at("left_thigh") - self._at("right_thigh")
        lengths = np.array([self.leg, self.arm, np.linalg.norm(up), np.linalg.norm(left)])
        ahead = np.cross(left, up)
        if not np.isfinite(lengths).all() or min(lengths.min(), np.linalg.norm(ahead)) <= 0.0:
            raise ClipError(f"{file}: its limbs have no length in the rest pose; check the file")
        self.up = up / lengths[2]
        self.ahead = ahead / np.linalg.norm(ahead)
        self.left: _Vector = np.cross(self.up, self.ahead)

    def _at(self, part: str) -> _Vector:
        """Return where a part's joint is in the rest pose (mm, from the root)."""
        place: _Vector = self._rest[self._joints[part]]
        return place

    def _middle(self, limb: str) -> _Vector:
        """Return what lies between the joints of left and right."""
        middle: _Vector = np.mean([self._at(f"{side}_{limb}") for side in SIDES], axis=0)
        return middle

    def _chain(self, *limbs: str) -> float:
        """Return the length from joint to joint (mm), the mean of both sides."""
        return float(
            sum(
                np.linalg.norm(self._at(f"{side}_{other}") - self._at(f"{side}_{one}"))
                for one, other in pairwise(limbs)
                for side in SIDES
            )
            / len(SIDES)
        )

    @property
    def leg(self) -> float:
        """From hip to ankle (mm)."""
        return self._chain("thigh", "shank", "foot")

    @property
    def arm(self) -> float:
        """From shoulder to wrist (mm)."""
        return self._chain("upper_arm", "forearm", "hand")

    @cached_property
    def size(self) -> float:
        """Of the body as a whole (mm): leg, trunk and arm."""
        trunk = np.linalg.norm(self._middle("upper_arm") - self._middle("thigh"))
        return self.leg + float(trunk) + self.arm

    @cached_property
    def parts(self) -> dict[str, Part]:
        """All parts; those that the skeleton does not have move with the part before."""
        parts = {}
        shoulders, hips = self._middle("upper_arm"), self._middle("thigh")
        width = float(np.linalg.norm(self._at("left_upper_arm") - self._at("right_upper_arm")))
        trunk = np.array([np.linalg.norm(shoulders - hips), width, self.size])
        all_round = np.full(3, self.size)
        for name, origin, size in (
            ("pelvis", hips, all_round),
            ("thorax", shoulders, trunk),
            ("head", self._at("head"), all_round),
            ("left_shoulder", shoulders, trunk),
            ("right_shoulder", shoulders, trunk),
        ):
            parts[name] = self._part(name, origin, self.up, size)
        for side in SIDES:
            for limb, follows in (
                *(("upper_arm", "forearm"), ("forearm", "hand")),
                *(("thigh", "shank"), ("shank", "foot")),
            ):
                name = f"{side}_{limb}"
                along = self._at(f"{side}_{follows}") - self._at(name)
                size = np.array([np.linalg.norm(along), self.size, self.size])
                parts[name] = self._part(name, self._at(name), along, size)
            fore, hand, foot = (f"{side}_{limb}" for limb in ("forearm", "hand", "foot"))
            elbow, wrist = self._at(fore), self._at(hand)
            below = elbow + WRIST * (wrist - elbow)
            parts[f"{side}_wrist"] = self._part(
                f"{side}_wrist", below, wrist - elbow, parts[fore].size
            )
            # where hands and feet end kinds of skeletons do not agree, so it gives no size
            along = self._ends[self._joints[hand]] - wrist
            parts[hand] = self._part(hand, wrist, along, all_round)
            # nor how steep the bone of a foot is; but all stand on flat soles
            shank = self._at(foot) - self._at(f"{side}_shank")
            shank -= (shank @ self.ahead) * self.ahead
            parts[foot] = self._part(foot, self._at(foot), shank, all_round)
        return {name: parts[name] for name in PARTS}

    def _part(self, name: str, origin: _Vector, along: _Vector, size: _Vector) -> Part:
        """Return a part; ``size`` has that along the limb first."""
        joint = self._joints.get(name)
        if joint is None:
            side, limb = name.split("_", 1)
            joint = self._joints[f"{side}_{BEFORE[limb]}"]
        if np.linalg.norm(along) == 0.0:  # a bone without an end: what the part before does
            along = origin - self._rest[self._skeleton.parents[joint]]
        length = float(np.linalg.norm(along))
        if length == 0.0:
            raise ClipError(f"{self._file}: {name} has no length in the rest pose; check the file")
        first = along / length
        # the smallest turn of the body's own axes that makes one of them point along the limb
        body = np.stack([self.up, self.left, self.ahead])
        share = body @ first
        nearest = int(np.argmax(np.abs(share)))
        turn = _shortest_turn(np.sign(share[nearest]) * body[nearest], first)
        sizes = np.array(size[1:])
        return Part(
            joint,
            origin - self._rest[joint],
            turn @ body.T,
            np.insert(sizes, nearest, size[0]),
        )


def _shortest_turn(start: _Vector, end: _Vector) -> NDArray[np.float64]:
    """Return the smallest rotation of one unit vector to another less than 180 degrees away."""
    axis, cosine = np.cross(start, end), float(start @ end)
    across = np.array(
        [[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]]
    )
    turn: NDArray[np.float64] = np.eye(3) + across + across @ across / (1.0 + cosine)
    return turn


def part_frames(
    part: Part, placed: Placed, mm_per_unit: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a part's frame in the world.

    Parameters
    ----------
    part : Part
        The part.
    placed : Placed
        Where the joints are.
    mm_per_unit : float
        Millimetres in its unit of length.

    Returns
    -------
    origin : ndarray [shape=(frames, 3), mm]
    axes : ndarray [shape=(frames, 3, 3), mm]
        As columns, each as long as the part's size along it.
    """
    turned = placed.rotations[:, part.joint]
    origin = placed.places[:, part.joint] * mm_per_unit + turned @ part.origin
    return origin, turned @ (part.axes * part.size)

"""The body of a skeleton: frames of its parts, comparable between skeletons.

Skeletons differ in their bones, the axes of their joints, and their rest poses. A file's rotation
of a joint is known up to a constant that depends on the rest pose. The frames of body parts are
therefore found from where joints are during the motion: trunk and pelvis from hips and shoulders,
limbs from their direction and the axis about which knee or elbow bends. Each frame is then fixed in
the part's joint, by an average over the motion, and rotates with it. Nothing depends on the rest
pose or the heading.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.skeleton.find_joints import BodyJoints
from priorfill.skeleton.part_names import PARTS, SIDES

__all__ = ["PartFrame", "SkeletonBody", "unit_vectors"]

WRIST_FRACTION = 2.0 / 3.0
"""Fraction of the forearm at which the part begins that rotates with the hand, as in ASF."""

STANDING_DEGREES = 10.0
"""deg. Frames in which the hips are bent by so much more than in the straightest frame count about
half in averages over the motion."""

ARM_DEGREES = 60.0
"""deg. The same for arms that are raised, which lift the shoulders."""

STRAIGHT = np.sin(np.deg2rad(8.0)) ** 2
"""Squared sine of the flexion of a knee or elbow at which its hinge axis and the frame of the trunk
count alike."""

MIN_RIGID = np.cos(np.deg2rad(12.0))
"""Mean cosine between directions of a bone in the frame of its joint, if it moves with it."""

MIN_HINGE = 0.9
"""Mean resultant length of hinge axes in the frame of the joint above, if its twist is that of the
limb."""

_Floats = NDArray[np.float64]


TOE_SLOPE = np.deg2rad(23.0)
"""rad. Usual slope of the line from ankle to toes when the sole is level."""

TOE_DISTANCE = 0.08
"""Distance from the ankle to the toes, relative to the size of the body."""

MAX_SLOPE_ERROR = np.deg2rad(25.0)
"""rad. A slope that differs more from the usual one was not measured on a level sole."""

SLOPE_WEIGHT = 0.7
"""Weight of the slope where the foot rests, relative to the usual one, if the foot is still."""

RESTING_SPREAD = np.deg2rad(6.0)
"""rad. Spread of the sole's directions that halves this weight."""

EYES_ABOVE = np.deg2rad(45.0)
"""rad. Elevation of the eyes, seen from the joint of the head."""

PRONATION = np.deg2rad(60.0)
"""rad. Usual angle by which the thumb is turned inwards from the plane in which the elbow bends."""

MIN_TIP = 0.01
"""Least distance of a thumb or eye from its joint that gives a direction, relative to the body's
size."""

RESTING_HEIGHT = 0.015
"""Height of a resting ankle above its lowest, relative to the body's size."""


@dataclass(frozen=True, eq=False)
class PartFrame:
    """The frame of a part of a body during a motion.

    Attributes
    ----------
    origin : ndarray [shape=(frames, 3), mm]
        Its origin.
    axes : ndarray [shape=(frames, 3, 3), mm]
        As columns up, left and ahead, for limbs as if they hung down; their lengths are the part's
        sizes.
    """

    origin: _Floats
    axes: _Floats

    def rows(self, rows: slice | NDArray[np.intp]) -> PartFrame:
        """Return some frames of the motion."""
        return PartFrame(self.origin[rows], self.axes[rows])


class SkeletonBody:
    """The body of a skeleton in motion.

    Where the unit of length is not known yet, it is that of the file in place of mm.

    Parameters
    ----------
    joints : BodyJoints
        The joints of its parts.
    positions : ndarray [shape=(frames, joints, 3), mm]
        The skeleton's joints.
    rotations : ndarray [shape=(frames, joints, 3, 3)]
        Rotation of each joint, up to a constant rotation before it.
    parents : tuple of int
        The number of each joint's parent.
    ends : ndarray [shape=(joints, 3), mm]
        From each joint to the end of its bone, in the joint's frame; 0 if unknown.
    """

    def __init__(
        self,
        joints: BodyJoints,
        positions: _Floats,
        rotations: _Floats,
        parents: tuple[int, ...],
        ends: _Floats,
    ) -> None:
        self.joints = joints
        self._positions, self._rotations = positions, rotations
        self._parents, self._ends = parents, ends

    def at(self, part: str) -> _Floats:
        """Return the positions of a part's joint [shape=(frames, 3), mm]."""
        return self._positions[:, self.joints.parts[part]]

    def midpoint(self, limb: str) -> _Floats:
        """Return the midpoints of the left and the right joint [shape=(frames, 3), mm]."""
        middle: _Floats = 0.5 * (self.at(f"left_{limb}") + self.at(f"right_{limb}"))
        return middle

    def length(self, start: str, end: str) -> float:
        """Return the median distance of two parts' joints (mm)."""
        return float(np.median(np.linalg.norm(self.at(end) - self.at(start), axis=1)))

    def mean_length(self, *limbs: str) -> float:
        """Return the length from joint to joint (mm), averaged over both sides."""
        return 0.5 * sum(
            self.length(f"{side}_{start}", f"{side}_{end}")
            for start, end in pairwise(limbs)
            for side in SIDES
        )

    @property
    def leg(self) -> float:
        """Length from hip to ankle (mm)."""
        return self.mean_length("thigh", "shank", "foot")

    @property
    def arm(self) -> float:
        """Length from shoulder to wrist (mm)."""
        return self.mean_length("upper_arm", "forearm", "hand")

    @cached_property
    def trunk(self) -> float:
        """Length from the hips to the shoulders (mm), where the body is straightest."""
        lengths = np.linalg.norm(self.midpoint("upper_arm") - self.midpoint("thigh"), axis=1)
        return float(self._resting @ lengths / self._resting.sum())

    @cached_property
    def size(self) -> float:
        """Size of the body (mm): lengths of leg, trunk and arm."""
        return self.leg + self.trunk + self.arm

    @cached_property
    def up(self) -> _Floats:
        """Direction from the hips to the shoulders [shape=(frames, 3)]."""
        return unit_vectors(self.midpoint("upper_arm") - self.midpoint("thigh"))

    @cached_property
    def upward(self) -> _Floats:
        """The axis of the file that points up most nearly, on average from feet to shoulders."""
        mean = unit_vectors(self.midpoint("upper_arm") - self.midpoint("foot")).mean(axis=0)
        axis = int(np.argmax(np.abs(mean)))
        upward: _Floats = np.eye(3)[axis] * (1.0 if mean[axis] >= 0.0 else -1.0)
        return upward

    @cached_property
    def hip_flexion(self) -> _Floats:
        """Angle between trunk and thighs, 0 where the body is straight [shape=(frames,), rad]."""
        thighs = unit_vectors(self.midpoint("shank") - self.midpoint("thigh"))
        return np.arccos(np.clip(-_dot(self.up, thighs), -1.0, 1.0))

    @cached_property
    def _standing(self) -> _Floats:
        """Weight of each frame in averages: large where the body is straight."""
        away = self.hip_flexion - self.hip_flexion.min()
        weights: _Floats = np.exp(-0.5 * (away / np.deg2rad(STANDING_DEGREES)) ** 2)
        return weights

    @cached_property
    def _resting(self) -> _Floats:
        """Weight of each frame in averages: large where the body is straight and arms hang down."""
        weights = self._standing
        for side in SIDES:
            arm = unit_vectors(self.at(f"{side}_forearm") - self.at(f"{side}_upper_arm"))
            raised = np.arccos(np.clip(-_dot(self.up, arm), -1.0, 1.0))
            weights = weights * np.exp(-0.5 * (raised / np.deg2rad(ARM_DEGREES)) ** 2)
        return weights + 1e-6 * self._standing

    def tip(self, part: str) -> _Floats | None:
        """Return the direction from a part's joint to the end of its bone; None if unknown."""
        joint, tip = self.joints.parts[part], self.joints.tips.get(part)
        if tip is not None:
            along = self._positions[:, tip] - self._positions[:, joint]
        elif self._ends[joint].any():
            along = self._rotations[:, joint] @ self._ends[joint]
        else:
            return None
        return None if np.linalg.norm(along, axis=1).min() <= 0.0 else unit_vectors(along)

    def _tip_of(self, tip: str, start: _Floats) -> _Floats | None:
        """Return the directions to a thumb or eye from a point; None if the skeleton has none."""
        joint = self.joints.tips.get(tip)
        if joint is None:
            return None
        along = self._positions[:, joint] - start
        if np.linalg.norm(along, axis=1).min() < MIN_TIP * self.size:
            along = along + self._rotations[:, joint] @ self._ends[joint]
        short = np.linalg.norm(along, axis=1).min() < MIN_TIP * self.size
        return None if short else unit_vectors(along)

    @cached_property
    def frames(self) -> dict[str, PartFrame]:
        """The frames of all parts."""
        axes, origins = self._trunk_axes(), {}
        for side in SIDES:
            axes |= self._arm_axes(side, axes["thorax"]) | self._leg_axes(side, axes["pelvis"])
            elbow, wrist = self.at(f"{side}_forearm"), self.at(f"{side}_hand")
            origins[f"{side}_wrist"] = elbow + WRIST_FRACTION * (wrist - elbow)
            origins[f"{side}_shoulder"] = self.at(f"{side}_upper_arm")
        origins["pelvis"] = self.midpoint("thigh")
        origins["thorax"] = self._carried_point("thorax", self.midpoint("upper_arm"), axes)
        sizes = self._sizes()
        return {
            # up, left, ahead
            part: PartFrame(
                origins[part] if part in origins else self.at(part),
                axes[part][:, :, ::-1] * sizes.get(part, np.full(3, self.size)),
            )
            for part in PARTS
        }

    def _sizes(self) -> dict[str, _Floats]:
        """Return the unit of length along each axis (mm) of parts that have lengths."""
        width = float(np.median(np.linalg.norm(
            self.at("left_upper_arm") - self.at("right_upper_arm"), axis=1)))  # fmt: skip
        sizes = {"thorax": np.array([self.trunk, width, self.size])}
        for side in SIDES:
            for limb, end in (
                *(("upper_arm", "forearm"), ("forearm", "hand")),
                *(("thigh", "shank"), ("shank", "foot")),
            ):
                length = self.length(f"{side}_{limb}", f"{side}_{end}")
                sizes[f"{side}_{limb}"] = np.array([length, self.size, self.size])
            sizes[f"{side}_wrist"] = sizes[f"{side}_forearm"]
        return sizes

    def _trunk_axes(self) -> dict[str, _Floats]:
        """Return the axes (ahead, left, up) of pelvis, thorax and head."""
        hips = self.at("left_thigh") - self.at("right_thigh")
        shoulders = self.at("left_upper_arm") - self.at("right_upper_arm")
        pelvis = self._carried(
            "pelvis", _axes(left=hips, up=self.up), ["left_thigh", "right_thigh"]
        )
        thorax = self._carried("thorax", _axes(up=self.up, left=shoulders), ["head"])
        head = self._carried("head", thorax, [])
        top = self.tip("head")
        left_eye, right_eye = (self._tip_of(f"{side}_eye", self.at("head")) for side in SIDES)
        if left_eye is not None and right_eye is not None:
            seen = _axes(left=left_eye - right_eye, ahead=left_eye + right_eye)
            head = seen @ _pitch(-EYES_ABOVE)
        elif top is not None:
            head = _axes(up=top, left=head[:, :, 1])
        return {"pelvis": pelvis, "thorax": thorax, "head": head}

    def _carried(self, part: str, axes: _Floats, ends: list[str]) -> _Floats:
        """Return axes that move with a part's joint and are the given ones on average.

        If the joint's rotation is not that of the part, the given axes are returned.
        """
        joint = self._moving_joint(part, ends)
        if joint is None:
            return axes
        rotations = self._rotations[:, joint]
        mean = np.einsum("f,fji,fjk->ik", self._standing, rotations, axes)
        return rotations @ _nearest_rotation(mean)

    def _carried_point(self, part: str, points: _Floats, axes: dict[str, _Floats]) -> _Floats:
        """Return points that move with a part and are the given ones on average."""
        origin, rotations = self.at(part), axes[part]
        local = np.einsum("fji,fj->fi", rotations, points - origin)
        mean: _Floats = self._resting @ local / self._resting.sum()
        points_there: _Floats = origin + rotations @ mean
        return points_there

    def _moving_joint(self, part: str, ends: list[str]) -> int | None:
        """Return the joint that rotates with a part; None if no rotation is that of the part.

        In its frame, the joints where the part ends do not change their direction.
        """
        if not self._has_rotations:
            return None
        start = self.joints.parts[part]
        if not ends:
            return start
        for joint in self._between(start, self.joints.parts[ends[0]]):
            rotations = self._rotations[:, joint]
            if all(self._is_rigid(rotations, self.at(end) - self.at(part)) for end in ends):
                return joint
        return None

    def _between(self, start: int, end: int) -> list[int]:
        """Return the joints from one to the parent of another."""
        found = []
        joint = self._parents[end]
        while joint >= 0:
            found.append(joint)
            if joint == start:
                return found[::-1]
            joint = self._parents[joint]
        return [start]

    @staticmethod
    def _is_rigid(rotations: _Floats, along: _Floats) -> bool:
        if np.median(np.linalg.norm(along, axis=1)) <= 0.0:
            return True
        local = np.einsum("fji,fj->fi", rotations, unit_vectors(along))
        return bool(np.linalg.norm(local.mean(axis=0)) >= MIN_RIGID)

    @cached_property
    def _has_rotations(self) -> bool:
        """Whether the file has rotations; some give only positions."""
        used = sorted(set(self.joints.parts.values()))
        rotations = self._rotations[:, used]
        still = np.abs(rotations - rotations[:1, :1]).max() < 1e-6
        if not still:
            return True
        moved = self._positions[:, used] - self._positions[:, used[:1]]
        return bool(np.abs(moved - moved[:1]).max() < 1e-3 * self.leg)

    def _leg_axes(self, side: str, pelvis: _Floats) -> dict[str, _Floats]:
        hip, knee, ankle = (self.at(f"{side}_{limb}") for limb in ("thigh", "shank", "foot"))
        hinge = np.cross(unit_vectors(knee - hip), unit_vectors(ankle - knee))
        names = f"{side}_thigh", f"{side}_shank", f"{side}_foot"
        # a thigh hardly twists, so the pelvis tells left even if a skeleton's knee bends forwards
        seen = _turned(pelvis, hip - knee)[:, :, 1] * np.linalg.norm(hinge, axis=1)[:, None]
        if _dot(hinge, seen).sum() < 0.0:
            hinge = -hinge
        thigh, shank = self._hinged(names, knee - hip, ankle - knee, hinge, pelvis)
        toes = self.tip(names[2])
        if toes is None:
            foot = self._carried(names[2], shank, [])
        else:
            foot = _axes(ahead=toes, left=self._carried(names[2], shank, [])[:, :, 1])
            slope = self._toe_slope(ankle, foot)
            foot = foot @ _pitch(slope)
        return dict(zip(names, (thigh, shank, foot), strict=True))

    def _toe_slope(self, ankle: _Floats, foot: _Floats) -> float:
        """Return the slope of a foot's axis when its sole is level (rad).

        The sole is level where the foot is low and hardly moves.
        """
        height = ankle @ self.upward
        low = height <= np.percentile(height, 5.0) + RESTING_HEIGHT * self.size
        toes = ankle + TOE_DISTANCE * self.size * foot[:, :, 0]
        speed = sum(
            np.linalg.norm(np.diff(points, axis=0, append=points[-1:]), axis=1)
            for points in (ankle, toes)
        )
        still = low & (speed <= np.percentile(speed[low], 25.0))
        sole = np.einsum("fij,i->fj", foot[still], self.upward)
        mean = unit_vectors(sole.mean(axis=0))
        spread = float(np.arccos(np.clip(sole @ mean, -1.0, 1.0)).mean())
        slope = float(np.arctan2(-mean[0], mean[2]))
        if abs(slope - TOE_SLOPE) > MAX_SLOPE_ERROR:
            return float(TOE_SLOPE)
        weight = SLOPE_WEIGHT / (1.0 + (spread / RESTING_SPREAD) ** 2)
        return float(TOE_SLOPE + weight * (slope - TOE_SLOPE))

    def _arm_axes(self, side: str, thorax: _Floats) -> dict[str, _Floats]:
        shoulder, elbow, hand = (
            self.at(f"{side}_{limb}") for limb in ("upper_arm", "forearm", "hand")
        )
        # an elbow bends the other way than a knee
        hinge = -np.cross(unit_vectors(elbow - shoulder), unit_vectors(hand - elbow))
        names = f"{side}_upper_arm", f"{side}_forearm", f"{side}_hand"
        upper, fore = self._hinged(names, elbow - shoulder, hand - elbow, hinge, thorax)
        collar = f"{side}_shoulder"
        if self.joints.parts[collar] == self.joints.parts["thorax"]:
            girdle = thorax
        else:
            girdle = self._carried(collar, thorax, [f"{side}_upper_arm"])
        twisting = f"{side}_wrist" if f"{side}_wrist" in self.joints.parts else names[1]
        wrist = self._carried(twisting, fore, [names[2]])
        wrist = _axes(up=elbow - hand, left=wrist[:, :, 1])
        fingers = self.tip(names[2])
        palm = self._carried(names[2], wrist if fingers is None else _turned(wrist, -fingers), [])
        thumb = self._tip_of(f"{side}_thumb", hand)
        if thumb is None:
            inwards = PRONATION if side == "left" else -PRONATION
            palm = palm @ _yaw(-inwards)
        else:
            palm = self._carried(names[2], _axes(up=palm[:, :, 2], ahead=thumb), [])
        found = (girdle, upper, fore, wrist, palm)
        return dict(
            zip((collar, names[0], names[1], f"{side}_wrist", names[2]), found, strict=True)
        )

    def _hinged(
        self,
        names: tuple[str, str, str],
        first: _Floats,
        second: _Floats,
        hinge: _Floats,
        trunk: _Floats,
    ) -> tuple[_Floats, _Floats]:
        """Return the axes of the two long bones of a limb.

        Parameters
        ----------
        names : tuple of str
            The limb's parts.
        first, second : ndarray [shape=(frames, 3), mm]
            The bones.
        hinge : ndarray [shape=(frames, 3)]
            To the left of the limb, as long as the sine of the flexion.
        trunk : ndarray [shape=(frames, 3, 3)]
            Axes of the part that carries the limb, which give the limb's twist if it is straight
            throughout.
        """
        turned = _turned(trunk, -first)
        # a limb that points up does not show its twist
        known = 0.5 * (1.0 - _dot(unit_vectors(first), trunk[:, :, 2]))
        prior = (STRAIGHT * self._standing / self._standing.mean() * known**2)[:, None]
        bent = np.linalg.norm(hinge, axis=1)
        joint = self._moving_joint(names[0], [names[1]])
        base = turned if joint is None else self._rotations[:, joint]
        evidence = np.einsum("fji,fj->fi", base, hinge * bent[:, None]).sum(axis=0)
        given = np.einsum("fji,fj->fi", base, prior * turned[:, :, 1]).sum(axis=0)
        left = base @ unit_vectors(evidence + given)
        resultant = np.linalg.norm(evidence) / max(float((bent**2).sum()), 1e-12)
        if joint is None or resultant < MIN_HINGE:
            # the rotation's twist is not the limb's: follow the hinge where the limb is bent
            trusted = bent**2 * np.clip(_dot(unit_vectors(hinge), left), 0.0, None)
            left = left * 4.0 * STRAIGHT + unit_vectors(hinge) * trusted[:, None]
        upper = _axes(up=-first, left=left)
        return upper, _axes(up=-second, left=upper[:, :, 1])


def _dot(one: _Floats, other: _Floats) -> _Floats:
    product: _Floats = np.einsum("...i,...i->...", one, other)
    return product


def unit_vectors(vectors: _Floats) -> _Floats:
    """Return vectors of length 1; those of length 0 stay so."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    unit: _Floats = vectors / np.where(lengths > 0.0, lengths, 1.0)
    return unit


def _axes(**directions: _Floats) -> _Floats:
    """Return orthonormal axes (ahead, left, up) as columns.

    Parameters
    ----------
    **directions : ndarray [shape=(frames, 3)]
        Two of ``up``, ``left`` and ``ahead``; the first is kept, the second made orthogonal to it.
    """
    (first, one), (second, other) = directions.items()
    one = unit_vectors(one)
    other = other - _dot(other, one)[:, None] * one
    short = np.linalg.norm(other, axis=1) < 1e-9
    if short.any():
        other = np.where(short[:, None], _any_orthogonal(one), other)
    known = {first: one, second: unit_vectors(other)}
    if "up" not in known:
        known["up"] = np.cross(known["ahead"], known["left"])
    if "left" not in known:
        known["left"] = np.cross(known["up"], known["ahead"])
    if "ahead" not in known:
        known["ahead"] = np.cross(known["left"], known["up"])
    return np.stack([known["ahead"], known["left"], known["up"]], axis=2)


def _any_orthogonal(vectors: _Floats) -> _Floats:
    """Return vectors orthogonal to others."""
    helper = np.eye(3)[np.argmin(np.abs(vectors), axis=1)]
    return np.cross(vectors, helper)


def _turned(axes: _Floats, up: _Floats) -> _Floats:
    """Return axes after the smallest rotation that makes them point up as given."""
    start, end = axes[:, :, 2], unit_vectors(up)
    cosine = np.maximum(_dot(start, end), -1.0 + 1e-6)
    axis = np.cross(start, end)
    cross = np.zeros((len(axes), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -axis[:, 2], axis[:, 1], -axis[:, 0]
    cross -= np.swapaxes(cross, 1, 2)
    rotation = np.eye(3) + cross + cross @ cross / (1.0 + cosine)[:, None, None]
    turned: _Floats = rotation @ axes
    return turned


def _pitch(angle: float) -> _Floats:
    """Return the rotation that raises the axis ahead by an angle (rad)."""
    sine, cosine = np.sin(angle), np.cos(angle)
    return np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])


def _yaw(angle: float) -> _Floats:
    """Return the rotation that turns the axis ahead to the left by an angle (rad)."""
    sine, cosine = np.sin(angle), np.cos(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _nearest_rotation(matrix: _Floats) -> _Floats:
    """Return the rotation nearest to a matrix."""
    u, _, vt = np.linalg.svd(matrix)
    sign = np.sign(np.linalg.det(u @ vt))
    rotation: _Floats = (u * np.array([1.0, 1.0, sign])) @ vt
    return rotation

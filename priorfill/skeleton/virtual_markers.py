"""Compute the virtual markers of a marker set from a skeleton's motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import ClipError
from priorfill.markers.marker_set import MarkerSet, same_markers
from priorfill.skeleton.body_checks import (
    check_body,
    check_markers,
    find_unit,
    is_mirrored,
    knees_bend_forwards,
)
from priorfill.skeleton.find_joints import BodyJoints, find_joints
from priorfill.skeleton.joints import SkeletonMotion, forward_kinematics, part_of_motion
from priorfill.skeleton.marker_sites import known_sites, marker_positions
from priorfill.skeleton.part_names import LIMBS
from priorfill.skeleton.skeleton_body import SkeletonBody

__all__ = ["DEFAULT_RATE", "VirtualMarkers", "body_of", "compute_virtual_markers"]

DEFAULT_RATE = 120.0
"""Hz. AMC files do not state their rate; those of CMU and HDM05 have this one."""

MIN_MARKERS = 10
"""Minimum number of markers of a useful clip."""

MAX_SPEED = 20_000.0
"""mm/s. Faster than any body part: a first frame this far from the second is a calibration pose."""

MAX_SAMPLES = 20_000_000
"""Maximum number of positions of joints, for 4 GB of memory; an hour at 120 Hz has half as many."""

NEAR_FLOOR = 0.08
"""Distance of the lowest joint from the floor, relative to the body's size."""

LYING_HEIGHT = 0.4
"""Height of the highest joint of a body that lies, relative to its size."""

MAX_STILL = 3
"""Ratio of all joints to those that move above which a small file would take much memory ..."""

MAX_STILL_SAMPLES = 2_000_000
"""... and the maximum number of positions of joints in such a file."""

MIN_TURN = 0.5
"""deg. Largest angle of a file without motion."""

MAX_RADIANS = 9.5
"""Largest angle of a file in radians: three of up to pi are combined."""

USUAL_UP = ("+Y", "+Z")
"""Axes that point up in skeleton files, the most common first."""


class VirtualMarkers(NamedTuple):
    """Markers computed from a skeleton's motion.

    Attributes
    ----------
    clip : Clip
        The markers, in the order of the marker set.
    notes : tuple of str
        What was assumed about the file.
    """

    clip: Clip
    notes: tuple[str, ...]


def compute_virtual_markers(
    motion: SkeletonMotion,
    marker_set: MarkerSet,
    *,
    name: str,
    file: str,
    rate: float | None = None,
    mm_per_unit: float | None = None,
    up: str | None = None,
    joints: Mapping[str, str] | None = None,
) -> VirtualMarkers:
    """Compute the markers of a marker set from a skeleton's motion.

    Nothing depends on the skeleton's rest pose.

    Parameters
    ----------
    motion : SkeletonMotion
        The motion.
    marker_set : MarkerSet
        Its markers whose sites on the body are known are computed.
    name : str
        Name of the clip.
    file : str
        Name of the file for messages.
    rate : float, optional
        Frames per second (Hz); by default the motion's, or `DEFAULT_RATE`.
    mm_per_unit : float, optional
        Millimetres in the skeleton's unit of length; by default the skeleton's, or a usual unit
        that gives the body the height of a person.
    up : str, optional
        The axis that points up; by default the one along which the body stands.
    joints : mapping of str to str, optional
        The names of joints by part of the body (`priorfill.skeleton.part_names.PARTS`); others are
        recognised.

    Returns
    -------
    VirtualMarkers

    Raises
    ------
    ClipError
        If joints are not recognised, the body is not that of a person, or the sites of too few
        markers are known.
    """
    sites = known_sites()
    here, there = same_markers(marker_set.labels, tuple(sites), marker_set)
    if len(here) < MIN_MARKERS:
        raise ClipError(
            f"{file}: only {len(here)} markers of marker set {marker_set.name} can be computed "
            "from skeletons; take another set, such as baumann41"
        )
    known = list(sites.values())
    wanted = {marker_set.labels[i]: known[j] for i, j in zip(here, there, strict=True)}
    hertz = rate or motion.rate or DEFAULT_RATE
    body, notes = body_of(motion, file, joints=joints, mm_per_unit=mm_per_unit)
    if not (rate or motion.rate):
        notes = (*notes, f"{hertz:g} Hz assumed (else give `rate`)")
    check_body(body, hertz, file)
    positions = marker_positions(wanted, body.frames)
    check_markers(positions, wanted, body, file)
    turn = _largest_turn(motion)
    if MIN_TURN < turn < MAX_RADIANS:
        notes = (
            *notes,
            f"no joint turns by more than {turn:.1f} degrees, check whether angles are in radians",
        )
    if knees_bend_forwards(body):
        notes = (*notes, "the knees bend forwards, check the file")
    if up is None:
        up, about_up = _find_up(body)
        notes = (*notes, *about_up)
    positions = positions[_first_frame(positions, hertz) :]
    return VirtualMarkers(Clip(positions, tuple(wanted), hertz, up=up, name=name), notes)


def body_of(
    motion: SkeletonMotion,
    file: str,
    *,
    joints: Mapping[str, str] | None = None,
    mm_per_unit: float | None = None,
) -> tuple[SkeletonBody, tuple[str, ...]]:
    """Return the body of a skeleton in motion, in mm.

    Parameters
    ----------
    motion : SkeletonMotion
        The motion.
    file : str
        Name of the file for messages.
    joints : mapping of str to str, optional
        The names of joints by part of the body; others are recognised.
    mm_per_unit : float, optional
        Millimetres in the skeleton's unit of length.

    Returns
    -------
    body : SkeletonBody
        The body.
    notes : tuple of str
        What was assumed about the file.

    Raises
    ------
    ClipError
        If joints are not recognised, or the body does not have the size of a person.
    """
    motion, found, notes = _person(motion, file, joints)
    skeleton = motion.skeleton
    samples = len(motion.root) * len(skeleton.names)
    moving = len(motion.turns) + len(motion.moves) + 1
    if samples > (MAX_SAMPLES if len(skeleton.names) <= MAX_STILL * moving else MAX_STILL_SAMPLES):
        raise ClipError(
            f"{file}: {len(motion.root)} frames of {len(skeleton.names)} joints are too many; "
            "export it in parts"
        )
    poses = forward_kinematics(motion)

    def body(scale: float, found: BodyJoints) -> SkeletonBody:
        positions = poses.positions if scale == 1.0 else poses.positions * scale
        return SkeletonBody(
            found, positions, poses.rotations, skeleton.parents, skeleton.ends * scale
        )

    in_units = body(1.0, found)
    scale, note = find_unit(in_units, mm_per_unit or skeleton.mm_per_unit, file)
    if not found.sides_named:
        found = _with_sides(found, in_units, body)
    return body(scale, found), (*notes, note) if note else notes


def _person(
    motion: SkeletonMotion, file: str, joints: Mapping[str, str] | None
) -> tuple[SkeletonMotion, BodyJoints, tuple[str, ...]]:
    """Return the joints of a body, alone, with notes about other skeletons of the file."""
    parents = motion.skeleton.parents
    root_of = list(range(len(parents)))
    for joint, parent in enumerate(parents):
        root_of[joint] = joint if parent < 0 else root_of[parent]
    roots = sorted(set(root_of))
    people: list[tuple[SkeletonMotion, BodyJoints, tuple[str, ...]]] = []
    errors: list[ClipError] = []
    for root in roots:
        own = [joint for joint in range(len(parents)) if root_of[joint] == root]
        one = part_of_motion(motion, own)
        try:
            found = find_joints(one.skeleton, _bone_lengths(one), file, joints)
        except ClipError as error:
            errors.append(error)
            continue
        if found.parts["head"] in one.skeleton.parents:
            # the joints on a head, such as its eyes, are not its top
            one.skeleton.ends[found.parts["head"]] = 0.0
        used = _with_ancestors({*found.parts.values(), *found.tips.values()}, one.skeleton.parents)
        note = (f"only the skeleton {one.skeleton.names[0]} of {len(roots)}",)
        people.append(
            (part_of_motion(one, used), found.numbered(used), note if len(roots) > 1 else ())
        )
    if not people:
        raise errors[0]
    if len(people) > 1:
        raise ClipError(
            f"{file}: has the skeletons of {len(people)} people; export each separately"
        )
    return people[0]


def _with_ancestors(joints: set[int], parents: tuple[int, ...]) -> list[int]:
    """Return joints and all above them, in ascending order."""
    for joint in range(len(parents) - 1, -1, -1):
        if joint in joints and parents[joint] >= 0:
            joints = {*joints, parents[joint]}
    return sorted(joints)


def _bone_lengths(motion: SkeletonMotion) -> NDArray[np.float64]:
    """Return the distance of each joint from its parent."""
    lengths: NDArray[np.float64] = np.linalg.norm(motion.skeleton.offsets, axis=1)
    for joint, move in motion.moves.items():
        if motion.skeleton.parents[joint] >= 0:
            lengths[joint] = np.median(np.linalg.norm(move, axis=1))
    return lengths


def _with_sides(
    found: BodyJoints, body: SkeletonBody, make: Callable[[float, BodyJoints], SkeletonBody]
) -> BodyJoints:
    """Return joints with left and right as the body's posture shows them."""
    arms, legs = (*LIMBS[:5], "thumb"), LIMBS[5:]
    hips = body.at("left_thigh") - body.at("right_thigh")
    shoulders = body.at("left_upper_arm") - body.at("right_upper_arm")
    if np.einsum("fi,fi->f", hips, shoulders).mean() < 0.0:
        found = found.exchanged(*arms)
        body = make(1.0, found)
    return found.exchanged(*arms, *legs) if is_mirrored(body) else found


def _largest_turn(motion: SkeletonMotion) -> float:
    """Return the largest angle by which a joint is turned (deg)."""
    traces = [np.trace(turn, axis1=1, axis2=2).min() for turn in motion.turns.values()]
    cosine = 0.5 * (min(traces, default=3.0) - 1.0)
    return float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _find_up(body: SkeletonBody) -> tuple[str, tuple[str, ...]]:
    """Return the axis that points up, and a note if it is not the usual one.

    No file has its first axis up, or another one down: then the body lies.
    """
    axis = int(np.argmax(np.abs(body.upward)))
    up = ("+" if body.upward[axis] > 0.0 else "-") + "XYZ"[axis]
    if up == USUAL_UP[0]:
        return up, ()
    if up in USUAL_UP and not _lies_on(body, "XYZ".index(USUAL_UP[0][1]), axis):
        return up, (f"{up} up, along which the body stands (else give `up`)",)
    return USUAL_UP[0], (
        f"{USUAL_UP[0]} up, as usual, as the body does not stand (else give `up`)",
    )


def _lies_on(body: SkeletonBody, usual: int, along: int) -> bool:
    """Return whether a body lies on a floor at 0 of the usual axis rather than stands on one."""
    joints = np.stack([body.at(part) for part in body.joints.parts], axis=1)
    lowest, highest = joints[:, :, usual].min(), joints[:, :, usual].max()
    lies = lowest > -NEAR_FLOOR * body.size and highest < LYING_HEIGHT * body.size
    feet = joints[:, :, along].min() / body.size
    return bool(lies and not -NEAR_FLOOR < feet < 2.0 * NEAR_FLOOR)


def _first_frame(positions: NDArray[np.float64], rate: float) -> int:
    """Return 1 if the first frame is a calibration pose, else 0."""
    if len(positions) < 2:
        return 0
    step = np.linalg.norm(positions[1] - positions[0], axis=1).max()
    return int(step * rate > MAX_SPEED)

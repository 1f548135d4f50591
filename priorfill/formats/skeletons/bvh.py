"""BVH (Biovision) files: a skeleton and its motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import FormatError
from priorfill.formats.file_bytes import read_bytes
from priorfill.formats.skeletons.numbered_lines import MAX_JOINTS, NumberedLines, NumberRows
from priorfill.skeleton.joints import Skeleton, SkeletonMotion, euler_rotations

__all__ = ["parse_bvh", "read_bvh"]

MAX_BVH_BYTES = 1 << 30
"""Size limit of a file: 6 hours of a skeleton with fingers at 120 Hz."""

MAX_CHAIN_JOINTS = 200
"""Maximum number of joints in a chain; no skeleton has as many."""

MAX_FRAME_SECONDS = 100.0
"""s. A longer frame time is ignored as invalid."""

RATE_DECIMALS = 2
"""Decimals of the rate (Hz). Frame times are rounded: 0.00833333 s means 120 Hz."""

_POSITION, _ROTATION = "position", "rotation"


@dataclass(eq=False)
class _Joint:
    """A joint of the hierarchy."""

    name: str
    parent: int
    line: int
    offset: tuple[float, ...] | None = None
    channels: tuple[str, ...] = ()
    first: int = 0  # first column among the values of a frame
    tips: list[tuple[float, ...]] = field(default_factory=list)  # offsets of its children


def read_bvh(path: Path) -> SkeletonMotion:
    """Read a skeleton and its motion.

    Raises
    ------
    FormatError
        If the file does not exist, is not BVH, or is damaged.
    """
    return parse_bvh(read_bytes(path, max_bytes=MAX_BVH_BYTES), str(path))


def parse_bvh(data: bytes, name: str) -> SkeletonMotion:
    """Parse the contents of a BVH file.

    Parameters
    ----------
    data : bytes
        The contents.
    name : str
        The file's name in messages.

    Returns
    -------
    SkeletonMotion
        The skeleton and its motion in file units, with the rate if it is plausible.

    Raises
    ------
    FormatError
        If the file is not BVH, or is damaged.
    """
    lines = NumberedLines(data, name)
    joints = _hierarchy(lines)
    skeleton = Skeleton(
        tuple(joint.name for joint in joints),
        tuple(joint.parent for joint in joints),
        # the position of a root is part of the motion
        np.array([np.zeros(3) if j.parent < 0 else j.offset for j in joints], dtype=np.float64),
        np.array([np.mean(j.tips, axis=0) if j.tips else np.zeros(3) for j in joints]),
    )
    width = sum(len(joint.channels) for joint in joints)
    values, rate = _values(lines, width)
    root = np.zeros((len(values), 3))
    adds = _positions_add(joints, values)
    turns: dict[int, NDArray[np.float64]] = {}
    moves: dict[int, NDArray[np.float64]] = {}
    for number, joint in enumerate(joints):
        columns = values[:, joint.first : joint.first + len(joint.channels)]
        turning = [k for k, c in enumerate(joint.channels) if c.endswith(_ROTATION)]
        if turning:
            order = "".join(joint.channels[k][0].upper() for k in turning)
            turns[number] = euler_rotations(order, np.deg2rad(columns[:, turning]))
        sliding = [k for k, c in enumerate(joint.channels) if c.endswith(_POSITION)]
        if sliding or (number and joint.parent < 0):
            place = np.broadcast_to(np.array(joint.offset), (len(values), 3)).copy()
            for column in sliding:
                axis = "xyz".index(joint.channels[column][0])
                if adds and joint.parent >= 0:
                    place[:, axis] += columns[:, column]
                else:
                    place[:, axis] = columns[:, column]
            if number:
                moves[number] = place
            else:
                root = place
    return SkeletonMotion(skeleton, root, turns, moves, rate)


def _positions_add(joints: list[_Joint], values: NDArray[np.float64]) -> bool:
    """Return whether positions of joints below a root add to their offsets.

    In most files they replace them, and are then similar to them.
    """
    replacing = adding = 0.0
    for joint in joints:
        sliding = [k for k, c in enumerate(joint.channels) if c.endswith(_POSITION)]
        if joint.parent < 0 or not sliding or joint.offset is None:
            continue
        given = values[:, [joint.first + k for k in sliding]]
        offset = np.array([joint.offset["xyz".index(joint.channels[k][0])] for k in sliding])
        replacing += float(np.median(np.linalg.norm(given - offset, axis=1)))
        adding += float(np.median(np.linalg.norm(given, axis=1)))
    return adding < replacing


def _hierarchy(lines: NumberedLines) -> list[_Joint]:
    """Parse from the first line to MOTION."""
    joints: list[_Joint] = []
    open_joints: list[int] = []  # from the root to the current joint; -1 for an end site
    named: int | None = None  # the joint whose { comes next
    columns = 0
    begun = False
    for words in _split_braces(lines):
        key = words[0].upper()
        if not begun:
            if key != "HIERARCHY":
                raise lines.error("does not begin with HIERARCHY", "give a BVH file")
            begun = True
        elif key == "MOTION":
            if open_joints or not joints:
                raise lines.error("the hierarchy is not closed ('}' is missing)")
            for joint in joints:
                if joint.offset is None:
                    raise lines.error(f"joint {joint.name} has no OFFSET", at=joint.line)
            return joints
        elif key in ("ROOT", "JOINT"):
            is_root = key == "ROOT"
            if is_root == bool(open_joints) or (open_joints and open_joints[-1] < 0):
                raise lines.error("a root inside a joint" if is_root else "a joint has no parent")
            if len(joints) >= MAX_JOINTS:
                raise lines.error(f"more than {MAX_JOINTS} joints")
            if len(open_joints) >= MAX_CHAIN_JOINTS:
                raise lines.error(f"more than {MAX_CHAIN_JOINTS} joints in a chain")
            joints.append(
                _Joint(" ".join(words[1:]), -1 if is_root else open_joints[-1], lines.line)
            )
            named = len(joints) - 1
        elif key == "END":
            if not open_joints:
                raise lines.error("an end site has no joint")
            named = -1
        elif key == "{":
            if named is None:
                raise lines.error("'{' does not follow a joint")
            open_joints.append(named)
            named = None
        elif key == "}":
            if not open_joints:
                raise lines.error("'}' without '{'")
            open_joints.pop()
        elif key == "OFFSET" and open_joints:
            _set_offset(joints, open_joints, words, lines)
        elif key == "CHANNELS" and open_joints and open_joints[-1] >= 0:
            joint = joints[open_joints[-1]]
            if joint.channels:
                raise lines.error(f"joint {joint.name} has CHANNELS twice")
            joint.channels, joint.first = _channels(words, lines), columns
            columns += len(joint.channels)
        else:
            raise lines.error(f"{words[0][:20]!r} is not expected here")
    raise lines.error("ends before MOTION", "the file is cut short, download it again")


def _set_offset(
    joints: list[_Joint], open_joints: list[int], words: list[str], lines: NumberedLines
) -> None:
    """Parse the offset of a joint or end site."""
    offset = lines.numbers(words[1:], 3, "an offset")
    here = open_joints[-1]
    if here >= 0 and joints[here].offset is not None:
        raise lines.error(f"joint {joints[here].name} has a second OFFSET")
    above = open_joints[-2] if here < 0 else joints[here].parent
    if here >= 0:
        joints[here].offset = offset
    if above >= 0:
        joints[above].tips.append(offset)


def _split_braces(lines: NumberedLines) -> Iterator[list[str]]:
    """Return lines of words, with braces on lines of their own."""
    for words in lines:
        if len(words) == 1 or ("{" not in words and "}" not in words):
            yield words
            continue
        begin = 0
        for at, word in enumerate([*words, "{"]):
            if word in ("{", "}"):
                if at > begin:
                    yield words[begin:at]
                if at < len(words):
                    yield [word]
                begin = at + 1


def _channels(words: list[str], lines: NumberedLines) -> tuple[str, ...]:
    """Return the names of a joint's channels, such as ``xrotation``."""
    count = lines.numbers(words[1:], 1, "the number of channels")[0]
    channels = tuple(word.lower() for word in words[2:])
    if count != len(channels):
        raise lines.error(f"states {words[1]} channels but names {len(channels)}")
    for kind in (_POSITION, _ROTATION):
        if sum(channel.endswith(kind) for channel in channels) > len("xyz"):
            raise lines.error(f"names more than 3 channels of {kind}")
    for channel in channels:
        if channel[0] not in "xyz" or channel[1:] not in (_POSITION, _ROTATION):
            raise lines.error(f"{channel!r} is not a channel such as Xposition or Xrotation")
    return channels


def _values(lines: NumberedLines, width: int) -> tuple[NDArray[np.float64], float | None]:
    """Parse the part after MOTION: values [shape=(frames, channels)] and rate (Hz)."""
    frames, seconds = -1, 0.0
    rows = NumberRows(lines, "a value of a channel")
    for words in lines:
        key = words[0].lower()
        if key.startswith("frames"):
            last = words[-1].rpartition(":")[2]
            frames = int(lines.numbers([last], 1, "the number of frames")[0])
        elif key == "frame" and len(words) > 1 and words[1].lower().startswith("time"):
            last = words[-1].rpartition(":")[2]
            seconds = lines.numbers([last], 1, "the time of a frame")[0]
        elif len(words) != width:
            raise lines.error(f"has {len(words)} values, but the joints have {width} channels")
        else:
            rows.add(words)
    if frames != len(rows):
        raise FormatError(
            f"{lines.name}: states {frames} frames but has {len(rows)}; the file is cut short or "
            "damaged, download it again"
        )
    if not len(rows):
        raise FormatError(f"{lines.name}: has no frames; export it again")
    rate = round(1.0 / seconds, RATE_DECIMALS) if 0.0 < seconds < MAX_FRAME_SECONDS else None
    return rows.array(), rate

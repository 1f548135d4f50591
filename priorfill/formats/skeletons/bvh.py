"""BVH: a skeleton and its motion in one file, as Biovision wrote it and most programs do."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import FormatError
from priorfill.formats.file_bytes import read_bytes
from priorfill.formats.skeletons.numbered_lines import GREATEST, NumberedLines
from priorfill.skeleton.joints import Motion, Skeleton, euler

__all__ = ["parse_bvh", "read_bvh"]

LARGEST = 1 << 30
"""Bytes of the largest file that is read: 6 hours of a skeleton with fingers at 120 Hz."""

DEEPEST = 200
"""Joints in a chain; no skeleton has as many."""

SLOWEST = 100.0
"""s. A longer time from frame to frame is nonsense."""

RATE_DECIMALS = 2
"""Of a rate in Hz: the times of frames are rounded, 0.00833333 s is 120 Hz."""

_POSITION, _ROTATION = "position", "rotation"


@dataclass(eq=False)
class _Joint:
    """What the hierarchy says of a joint."""

    name: str
    parent: int
    line: int
    offset: tuple[float, ...] | None = None
    channels: tuple[str, ...] = ()
    first: int = 0  # its first column among the values of a frame
    tips: list[tuple[float, ...]] = field(default_factory=list)  # of its children


def read_bvh(path: Path) -> Motion:
    """Read a skeleton and its motion.

    Raises
    ------
    FormatError
        Where the file is not there, or is no BVH file, or a damaged one.
    """
    return parse_bvh(read_bytes(path, max_bytes=LARGEST), str(path))


def parse_bvh(data: bytes, name: str) -> Motion:
    """Read what is in a BVH file; ``name`` is what to call it."""
    lines = NumberedLines(data, name)
    joints = _hierarchy(lines)
    skeleton = Skeleton(
        tuple(joint.name for joint in joints),
        tuple(joint.parent for joint in joints),
        # where a root is lies in its motion
        np.array([np.zeros(3) if j.parent < 0 else j.offset for j in joints], dtype=np.float64),
        np.array([np.mean(j.tips, axis=0) if j.tips else np.zeros(3) for j in joints]),
    )
    width = sum(len(joint.channels) for joint in joints)
    values, rate = _values(lines, width)
    root = np.zeros((len(values), 3))
    turns: dict[int, NDArray[np.float64]] = {}
    moves: dict[int, NDArray[np.float64]] = {}
    for number, joint in enumerate(joints):
        columns = values[:, joint.first : joint.first + len(joint.channels)]
        turning = [k for k, c in enumerate(joint.channels) if c.endswith(_ROTATION)]
        if turning:
            order = "".join(joint.channels[k][0].upper() for k in turning)
            turns[number] = euler(order, np.deg2rad(columns[:, turning]))
        sliding = [k for k, c in enumerate(joint.channels) if c.endswith(_POSITION)]
        if sliding:
            # in the place of the offset, as common programs write and read it
            place = np.broadcast_to(np.array(joint.offset), (len(values), 3)).copy()
            for column in sliding:
                place[:, "xyz".index(joint.channels[column][0])] = columns[:, column]
            if number:
                moves[number] = place
            else:
                root = place
    return Motion(skeleton, root, turns, moves, rate)


def _hierarchy(lines: NumberedLines) -> list[_Joint]:
    """Read from the first line to MOTION."""
    joints: list[_Joint] = []
    open_joints: list[int] = []  # from the root to where the reader is; -1 for an end site
    named: int | None = None  # the joint whose { comes next
    columns = 0
    begun = False
    for words in lines:
        key = words[0].upper()
        if not begun:
            if key != "HIERARCHY":
                raise lines.error("does not begin with HIERARCHY; it is no BVH file")
            begun = True
        elif key == "MOTION":
            if open_joints or not joints:
                raise lines.error("the hierarchy has no end; '}' is missing")
            for joint in joints:
                if joint.offset is None:
                    raise lines.error(f"joint {joint.name} has no OFFSET", at=joint.line)
            return joints
        elif key in ("ROOT", "JOINT"):
            if (key == "ROOT") != (not joints):
                raise lines.error("a file with two skeletons cannot be read; export each alone")
            if joints and (not open_joints or open_joints[-1] < 0):
                raise lines.error("a joint is in no other joint")
            if len(open_joints) >= DEEPEST:
                raise lines.error(f"more than {DEEPEST} joints follow each other")
            joints.append(
                _Joint(" ".join(words[1:]), open_joints[-1] if joints else -1, lines.line)
            )
            named = len(joints) - 1
        elif key == "END":
            if not open_joints:
                raise lines.error("an end site is in no joint")
            named = -1
        elif key == "{":
            if named is None:
                raise lines.error("'{' follows no joint")
            open_joints.append(named)
            named = None
        elif key == "}":
            if not open_joints:
                raise lines.error("'}' closes nothing")
            open_joints.pop()
        elif key == "OFFSET" and open_joints:
            offset = lines.numbers(words[1:], 3, "an offset")
            here = open_joints[-1]
            above = open_joints[-2] if here < 0 else joints[here].parent
            if here >= 0:
                joints[here].offset = offset
            if above >= 0:
                joints[above].tips.append(offset)
        elif key == "CHANNELS" and open_joints and open_joints[-1] >= 0:
            joint = joints[open_joints[-1]]
            joint.channels, joint.first = _channels(words, lines), columns
            columns += len(joint.channels)
        else:
            raise lines.error(f"{words[0][:20]!r} makes no sense here; the file is damaged")
    raise lines.error("ends before MOTION; the file is cut short, download it again")


def _channels(words: list[str], lines: NumberedLines) -> tuple[str, ...]:
    """Return the names of a joint's channels, such as ``xrotation``."""
    count = lines.numbers(words[1:], 1, "the number of channels")[0]
    channels = tuple(word.lower() for word in words[2:])
    if count != len(channels):
        raise lines.error(f"says {words[1]} channels and names {len(channels)}")
    for channel in channels:
        if channel[0] not in "xyz" or channel[1:] not in (_POSITION, _ROTATION):
            raise lines.error(f"{channel!r} is no channel such as Xposition or Xrotation")
    return channels


def _values(lines: NumberedLines, width: int) -> tuple[NDArray[np.float64], float | None]:
    """Read what follows MOTION: a row for each frame, and the rate (Hz)."""
    frames, seconds = -1, 0.0
    rows: list[list[str]] = []
    numbers: list[int] = []
    for words in lines:
        key = words[0].lower()
        if key.startswith("frames"):
            frames = int(lines.numbers([words[-1]], 1, "the number of frames")[0])
        elif key == "frame" and len(words) > 1 and words[1].lower().startswith("time"):
            seconds = lines.numbers([words[-1]], 1, "the time of a frame")[0]
        elif len(words) != width:
            raise lines.error(f"has {len(words)} values, and the joints have {width} channels")
        else:
            rows.append(words)
            numbers.append(lines.line)
    if frames != len(rows):
        raise FormatError(
            f"{lines.name}: says {frames} frames and has {len(rows)}; the file is cut short or "
            "damaged, download it again"
        )
    if not rows:
        raise FormatError(f"{lines.name}: has no frames; export it again")
    rate = round(1.0 / seconds, RATE_DECIMALS) if 0.0 < seconds < SLOWEST else None
    try:
        values = np.array(rows, dtype=np.float64)
        if (np.abs(values) <= GREATEST).all():
            return values, rate
    except ValueError:
        pass
    for row, line in zip(rows, numbers, strict=True):
        lines.numbers(row, width, "a value of a channel", at=line)
    raise AssertionError("a number that is none was not found")

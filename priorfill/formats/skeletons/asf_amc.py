"""ASF and AMC (Acclaim) files: a skeleton, and its motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import FormatError
from priorfill.formats.file_bytes import read_bytes
from priorfill.formats.skeletons.numbered_lines import MAX_JOINTS, NumberedLines, NumberRows
from priorfill.skeleton.joints import Skeleton, SkeletonMotion, euler_rotations

__all__ = ["AsfSkeleton", "find_asf", "parse_amc", "parse_asf", "read_amc", "read_asf"]

MAX_AMC_BYTES = 1 << 30
"""Size limit of a file: 20 hours of the CMU skeleton at 120 Hz."""

INCH = 25.4
"""mm."""

MIN_LENGTH_UNIT = 1e-4
"""Smallest unit of length; its inverse is the largest."""

ROOT = "root"

_ROTATIONS = {"rx": "X", "ry": "Y", "rz": "Z"}
_TRANSLATIONS = {"tx": 0, "ty": 1, "tz": 2}
_LENGTH = "l"
_COMMENT = "#"
_FLAG = ":"


@dataclass(frozen=True, eq=False)
class AsfSkeleton:
    """Skeleton of an ASF file, and the channels of the AMC files that move it.

    Attributes
    ----------
    skeleton : Skeleton
        Its joints, named after their bones.
    channels : dict of str to tuple of str
        Names of each bone's values in a frame, such as ``("rx", "ry")``.
    axes : ndarray [shape=(joints, 3, 3)]
        Axes of each joint, about which it rotates.
    degrees : bool
        Whether angles are in degrees.
    root : ndarray [shape=(3,), file units]
        Offset added to the root's position.
    """

    skeleton: Skeleton
    channels: dict[str, tuple[str, ...]]
    axes: NDArray[np.float64]
    degrees: bool
    root: NDArray[np.float64]


@dataclass(eq=False)
class _Root:
    """The root of an ASF file."""

    order: tuple[str, ...] = ("tx", "ty", "tz", "rx", "ry", "rz")
    axis: str = "XYZ"
    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    orientation: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass(eq=False)
class _Bone:
    """A bone of an ASF file."""

    line: int
    name: str = ""
    direction: tuple[float, ...] | None = None
    length: float | None = None
    axis: tuple[float, ...] = (0.0, 0.0, 0.0)
    order: str = "XYZ"
    channels: tuple[str, ...] = ()


def read_asf(path: Path) -> AsfSkeleton:
    """Read a skeleton.

    Raises
    ------
    FormatError
        If the file does not exist, is not ASF, or is damaged.
    """
    return parse_asf(read_bytes(path, max_bytes=MAX_AMC_BYTES), str(path))


def read_amc(path: Path, asf: AsfSkeleton) -> SkeletonMotion:
    """Read the motion of a skeleton.

    Raises
    ------
    FormatError
        If the file does not exist, is damaged, or does not fit the skeleton.
    """
    return parse_amc(read_bytes(path, max_bytes=MAX_AMC_BYTES), asf, str(path))


def find_asf(amc: Path) -> Path | None:
    """Return the ASF file in the folder of an AMC file that fits by name; None if there is none.

    ``HDM_dg.asf`` fits ``HDM_dg_06-03.amc``, ``01.asf`` fits ``01_02.amc``, and a file of the same
    name fits. Of several, the longest name is chosen. If no name fits, the only ASF file of the
    folder is chosen.
    """
    try:
        candidates = [file for file in amc.parent.iterdir() if file.suffix.lower() == ".asf"]
    except OSError:
        return None
    stem = amc.stem.lower()

    def fits(name: str) -> bool:
        return stem == name or (stem.startswith(name) and not stem[len(name)].isalnum())

    fitting = sorted((f for f in candidates if fits(f.stem.lower())), key=lambda f: -len(f.stem))
    if fitting:
        return fitting[0]
    return candidates[0] if len(candidates) == 1 else None


def parse_asf(data: bytes, name: str) -> AsfSkeleton:
    """Parse the contents of an ASF file.

    Parameters
    ----------
    data : bytes
        The contents.
    name : str
        The file's name in messages.

    Returns
    -------
    AsfSkeleton
        The skeleton in file units.

    Raises
    ------
    FormatError
        If the file is not ASF, or is damaged.
    """
    lines = NumberedLines(data, name, _COMMENT)
    length, angle = 1.0, "deg"
    root = _Root()
    bones: dict[str, _Bone] = {}
    children: dict[str, list[str]] = {}
    section = ""
    for words in lines:
        key = words[0].lower()
        if key.startswith(":"):
            section = key
        elif section == ":units":
            if key == "length":
                length = lines.numbers(words[1:], 1, "the unit of length")[0]
            elif key == "angle" and len(words) > 1:
                angle = words[1].lower()
        elif section == ":root":
            _read_root(root, key, words, lines)
        elif section == ":bonedata" and key == "begin":
            bone = _read_bone(lines)
            if bone.name in bones or bone.name.lower() == ROOT:
                raise lines.error(f"bone {bone.name} occurs twice", at=bone.line)
            if len(bones) >= MAX_JOINTS:
                raise lines.error(f"more than {MAX_JOINTS} bones", at=bone.line)
            bones[bone.name] = bone
        elif section == ":hierarchy" and key not in ("begin", "end"):
            if words[0] != ROOT and words[0] not in bones:
                raise lines.error(f"bone {words[0]} is not among those of :bonedata")
            children.setdefault(words[0], []).extend(words[1:])
            for child in words[1:]:
                if child not in bones:
                    raise lines.error(f"bone {child} is not among those of :bonedata")
    if not bones or not children:
        raise FormatError(
            f"{name}: has no {':hierarchy' if bones else ':bonedata'}, so it is not a complete ASF "
            "file; download it again"
        )
    if not MIN_LENGTH_UNIT <= length <= 1.0 / MIN_LENGTH_UNIT:
        raise FormatError(f"{name}: the unit of length is {length:g}; correct it")
    return _assemble(name, length, not angle.startswith("rad"), root, bones, children)


def _read_root(root: _Root, key: str, words: list[str], lines: NumberedLines) -> None:
    """Parse a line of the root."""
    if key == "order":
        root.order = tuple(word.lower() for word in words[1:])
        _check_channels(root.order, lines)
        if _LENGTH in root.order:
            raise lines.error("the root's order has 'l' instead of tx ty tz rx ry rz")
    elif key == "axis":
        root.axis = _order(words[1] if len(words) > 1 else "", lines)
    elif key == "position":
        root.position = lines.numbers(words[1:], 3, "the root's position")
    elif key == "orientation":
        root.orientation = lines.numbers(words[1:], 3, "the root's orientation")


def _read_bone(lines: NumberedLines) -> _Bone:
    """Parse from the line after ``begin`` to ``end``."""
    bone = _Bone(lines.line)
    for words in lines:
        key = words[0].lower()
        if key == "end":
            break
        if key == "name" and len(words) > 1:
            bone.name = words[1]
        elif key == "direction":
            bone.direction = lines.numbers(words[1:], 3, "a bone's direction")
        elif key == "length":
            bone.length = lines.numbers(words[1:], 1, "a bone's length")[0]
        elif key == "axis":
            bone.axis = lines.numbers(words[1:4], 3, "a bone's axis")
            bone.order = _order(words[4] if len(words) > 4 else "XYZ", lines)
        elif key == "dof":
            bone.channels = tuple(word.lower() for word in words[1:])
            _check_channels(bone.channels, lines)
        elif key == "begin" or key.startswith(":"):
            raise lines.error("a bone begins before the previous one has ended")
    else:
        raise lines.error("the file ends inside a bone", "download it again", at=bone.line)
    if not bone.name or bone.direction is None or bone.length is None:
        lacking = "name" if not bone.name else "direction" if bone.direction is None else "length"
        raise lines.error(f"the bone that begins here has no {lacking}", at=bone.line)
    return bone


def _order(word: str, lines: NumberedLines) -> str:
    order = word.upper()
    if sorted(order) != ["X", "Y", "Z"]:
        raise lines.error(f"{word!r} is not an order of axes such as XYZ")
    return order


def _check_channels(channels: Sequence[str], lines: NumberedLines) -> None:
    for channel in channels:
        if channel not in _ROTATIONS and channel not in _TRANSLATIONS and channel != _LENGTH:
            raise lines.error(f"{channel!r} is not a degree of freedom (rx ry rz tx ty tz l)")
        if channels.count(channel) > 1:
            raise lines.error(f"degree of freedom {channel} occurs twice")


def _assemble(
    name: str,
    length: float,
    degrees: bool,
    root: _Root,
    bones: dict[str, _Bone],
    children: dict[str, list[str]],
) -> AsfSkeleton:
    """Assemble the skeleton, parents before their children."""
    order, placed = [ROOT], {ROOT}
    parents, ends, offsets = [-1], [np.zeros(3)], [np.zeros(3)]
    for number, parent in enumerate(order):  # grows in the loop
        for child in children.get(parent, ()):
            if child in placed:
                raise FormatError(
                    f"{name}: bone {child} has two parents in :hierarchy; correct the file"
                )
            bone = bones[child]
            assert bone.direction is not None and bone.length is not None
            direction = np.array(bone.direction)
            size = float(np.linalg.norm(direction))
            placed.add(child)
            order.append(child)
            parents.append(number)
            offsets.append(ends[number])
            ends.append(direction / size * bone.length if size else np.zeros(3))
    axes = [_turn(root.axis, root.orientation, degrees)]
    axes += [_turn(bones[n].order, bones[n].axis, degrees) for n in order[1:]]
    channels = {n: bones[n].channels for n in order[1:] if bones[n].channels}
    channels[ROOT] = root.order
    skeleton = Skeleton(
        tuple(order),
        tuple(parents),
        np.array(offsets),
        np.array(ends),
        # lengths are inches times the unit
        INCH / length,
    )
    return AsfSkeleton(skeleton, channels, np.array(axes), degrees, np.array(root.position))


def _turn(order: str, angles: Sequence[float], degrees: bool) -> NDArray[np.float64]:
    """Return the rotation of an ``axis`` line: about world axes, in the order given."""
    values = np.array(angles[::-1], dtype=np.float64)
    return euler_rotations(order[::-1], np.deg2rad(values) if degrees else values)


def parse_amc(data: bytes, asf: AsfSkeleton, name: str) -> SkeletonMotion:
    """Parse the contents of an AMC file.

    Parameters
    ----------
    data : bytes
        The contents.
    asf : AsfSkeleton
        The skeleton that it moves.
    name : str
        The file's name in messages.

    Returns
    -------
    SkeletonMotion
        The motion in file units, without a rate.

    Raises
    ------
    FormatError
        If the file is damaged, or does not fit the skeleton.
    """
    lines = NumberedLines(data, name, _COMMENT)
    degrees = asf.degrees
    values = {bone: NumberRows(lines, f"a value of bone {bone}") for bone in asf.channels}
    frames = last = 0
    found: set[str] = set()  # the bones of this frame, and of the one before
    before: set[str] = set()
    for words in lines:
        first = words[0]
        if first.startswith(_FLAG):
            flag = first.upper()
            degrees = True if flag == ":DEGREES" else False if flag == ":RADIANS" else degrees
        elif len(words) == 1 and first.isascii() and first.isdigit():
            number = int(lines.numbers(words, 1, "a frame number")[0])
            if frames:
                if found != before:
                    _check_frame(lines, values, frames)
                if number != last + 1:
                    raise lines.error(f"frame {number} follows frame {last}", "export it again")
            frames, last = frames + 1, number
            found, before = set(), found
        elif not frames:
            raise lines.error("values precede the first frame number", "give an AMC file")
        else:
            wanted = asf.channels.get(first)
            if wanted is None:
                raise lines.error(
                    f"bone {first} cannot move or is not in the skeleton",
                    "give the right skeleton (`skeleton`)",
                )
            if len(words) - 1 != len(wanted):
                raise lines.error(
                    f"bone {first} has {len(words) - 1} values, but {len(wanted)} in the skeleton",
                    "give the right skeleton (`skeleton`)",
                )
            if len(values[first]) == frames:
                raise lines.error(f"bone {first} occurs twice in one frame")
            values[first].add(words[1:])
            found.add(first)
    if not frames:
        raise FormatError(
            f"{name}: has no frames; it is not a complete AMC file; download it again"
        )
    _check_frame(lines, values, frames)
    columns = {bone: rows.array() for bone, rows in values.items() if len(rows)}
    return _motion(asf, columns, frames, degrees)


def _check_frame(lines: NumberedLines, values: dict[str, NumberRows], frames: int) -> None:
    """Raise FormatError if a bone with values in earlier frames has none in the last one."""
    for bone, rows in values.items():
        # some files omit bones that never move
        if len(rows) != frames and (len(rows) or bone == ROOT):
            raise lines.error(
                f"bone {bone} has no values in frame {frames} of the file, which ends before "
                "this line",
                "the file is cut short or damaged, download it again",
            )


def _motion(
    asf: AsfSkeleton, columns: dict[str, NDArray[np.float64]], frames: int, degrees: bool
) -> SkeletonMotion:
    """Convert channel values to rotations and positions."""
    skeleton = asf.skeleton
    root = np.broadcast_to(asf.root, (frames, 3)).copy()
    turns: dict[int, NDArray[np.float64]] = {}
    moves: dict[int, NDArray[np.float64]] = {}
    for joint, bone in enumerate(skeleton.names):
        channels, values = asf.channels.get(bone, ()), columns.get(bone)
        axes = asf.axes[joint]
        turning = [c for c in channels if c in _ROTATIONS]
        local = np.broadcast_to(np.eye(3), (frames, 3, 3))
        if values is not None and turning:
            # rotations about world axes in the file's order, so the last is the outermost
            at = [channels.index(c) for c in turning[::-1]]
            angles = np.deg2rad(values[:, at]) if degrees else values[:, at]
            local = euler_rotations("".join(_ROTATIONS[c] for c in turning[::-1]), angles)
        if joint == 0:
            for column, channel in enumerate(channels):
                if values is not None and channel in _TRANSLATIONS:
                    root[:, _TRANSLATIONS[channel]] += values[:, column]
            turns[joint] = local @ axes
            continue
        if values is not None and turning:
            turns[joint] = axes @ local @ axes.T
        sliding = [(k, _TRANSLATIONS[c]) for k, c in enumerate(channels) if c in _TRANSLATIONS]
        if values is not None and sliding:
            moved = np.zeros((frames, 3))
            for column, axis in sliding:
                moved[:, axis] = values[:, column]
            moves[joint] = skeleton.offsets[joint] + moved @ axes.T
    return SkeletonMotion(skeleton, root, turns, moves)

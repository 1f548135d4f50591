"""ASF and AMC: a skeleton, and its motion, as Acclaim wrote them and Vicon's BodyBuilder does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import FormatError
from priorfill.formats.file_bytes import read_bytes
from priorfill.formats.skeletons.numbered_lines import GREATEST, NumberedLines
from priorfill.skeleton.joints import Motion, Skeleton, euler

__all__ = ["AsfSkeleton", "find_asf", "parse_amc", "parse_asf", "read_amc", "read_asf"]

LARGEST = 1 << 30
"""Bytes of the largest file that is read: 20 hours of CMU's skeleton at 120 Hz."""

INCH = 25.4
"""mm."""

ROOT = "root"

_ROTATIONS = {"rx": "X", "ry": "Y", "rz": "Z"}
_TRANSLATIONS = {"tx": 0, "ty": 1, "tz": 2}
_LENGTH = "l"
_NO_DATA = ("#", ":")


@dataclass(frozen=True, eq=False)
class AsfSkeleton:
    """A skeleton of an ASF file, and how AMC files move it.

    Attributes
    ----------
    skeleton : Skeleton
        Its joints; each bone's joint has the bone's name.
    channels : dict of str to tuple of str
        The values that a frame has for each bone, such as ``("rx", "ry")``.
    axes : ndarray [shape=(joints, 3, 3)]
        Each joint's own axes, about which it turns.
    degrees : bool
        Whether angles are in degrees.
    root : ndarray [shape=(3,), file units]
        What is added to the root's place.
    """

    skeleton: Skeleton
    channels: dict[str, tuple[str, ...]]
    axes: NDArray[np.float64]
    degrees: bool
    root: NDArray[np.float64]


@dataclass(eq=False)
class _Bone:
    """What an ASF file says of a bone."""

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
        Where the file is not there, or is no ASF file, or a damaged one.
    """
    return parse_asf(read_bytes(path, max_bytes=LARGEST), str(path))


def read_amc(path: Path, asf: AsfSkeleton) -> Motion:
    """Read the motion of a skeleton.

    Raises
    ------
    FormatError
        Where the file is not there, is damaged, or does not fit the skeleton.
    """
    return parse_amc(read_bytes(path, max_bytes=LARGEST), asf, str(path))


def find_asf(amc: Path) -> Path | None:
    """Return the skeleton that lies beside an AMC file by name, if there is one.

    ``HDM_dg.asf`` is for ``HDM_dg_06-03.amc``, ``01.asf`` for ``01_02.amc``, and one of the very
    same name is for that file. Of several, the longest name is meant. A folder with one ASF
    file alone has one skeleton.
    """
    try:
        beside = [file for file in amc.parent.iterdir() if file.suffix.lower() == ".asf"]
    except OSError:
        return None
    stem = amc.stem.lower()

    def fits(name: str) -> bool:
        return stem == name or (stem.startswith(name) and not stem[len(name)].isalnum())

    fitting = sorted((f for f in beside if fits(f.stem.lower())), key=lambda f: -len(f.stem))
    if fitting:
        return fitting[0]
    return beside[0] if len(beside) == 1 else None


def parse_asf(data: bytes, name: str) -> AsfSkeleton:
    """Read what is in an ASF file; ``name`` is what to call it."""
    lines = NumberedLines(data, name)
    length, angle = 1.0, "deg"
    root: dict[str, list[str]] = {}
    bones: dict[str, _Bone] = {}
    children: dict[str, list[str]] = {}
    section = ""
    for words in lines:
        key = words[0].lower()
        if key.startswith("#"):
            continue
        if key.startswith(":"):
            section = key
        elif section == ":units":
            if key == "length":
                length = lines.numbers(words[1:], 1, "the unit of length")[0]
            elif key == "angle" and len(words) > 1:
                angle = words[1].lower()
        elif section == ":root":
            root[key] = words[1:]
            if key in ("position", "orientation"):
                lines.numbers(words[1:], 3, f"the root's {key}")
        elif section == ":bonedata" and key == "begin":
            bone = _read_bone(lines)
            if bone.name in bones or bone.name.lower() == ROOT:
                raise lines.error(f"bone {bone.name} is there twice", at=bone.line)
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
            f"{name}: has no {':hierarchy' if bones else ':bonedata'}, so it is no whole ASF file; "
            "download it again"
        )
    if length <= 0.0:
        raise FormatError(f"{name}: the unit of length is {length:g}; correct it")
    return _assemble(name, length, not angle.startswith("rad"), root, bones, children)


def _read_bone(lines: NumberedLines) -> _Bone:
    """Read from behind ``begin`` to ``end``."""
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
            raise lines.error("a bone begins before the one before has its line 'end'")
    else:
        raise lines.error("ends within a bone; download the file again", at=bone.line)
    if not bone.name or bone.direction is None or bone.length is None:
        lacking = "name" if not bone.name else "direction" if bone.direction is None else "length"
        raise lines.error(f"the bone that begins here has no {lacking}", at=bone.line)
    return bone


def _order(word: str, lines: NumberedLines) -> str:
    order = word.upper()
    if sorted(order) != ["X", "Y", "Z"]:
        raise lines.error(f"{word!r} is no order of axes such as XYZ")
    return order


def _check_channels(channels: Sequence[str], lines: NumberedLines) -> None:
    for channel in channels:
        if channel not in _ROTATIONS and channel not in _TRANSLATIONS and channel != _LENGTH:
            raise lines.error(f"{channel!r} is no degree of freedom (rx ry rz tx ty tz l)")


def _assemble(
    name: str,
    length: float,
    degrees: bool,
    root: dict[str, list[str]],
    bones: dict[str, _Bone],
    children: dict[str, list[str]],
) -> AsfSkeleton:
    """Put the parts together, a parent before its children."""
    order = [ROOT]
    parents, ends, offsets = [-1], [np.zeros(3)], [np.zeros(3)]
    for number, parent in enumerate(order):  # grows meanwhile
        for child in children.get(parent, ()):
            if child in order:
                raise FormatError(
                    f"{name}: bone {child} has two parents in :hierarchy; correct the file"
                )
            bone = bones[child]
            assert bone.direction is not None and bone.length is not None
            direction = np.array(bone.direction)
            size = float(np.linalg.norm(direction))
            order.append(child)
            parents.append(number)
            offsets.append(ends[number])
            ends.append(direction / size * bone.length if size else np.zeros(3))
    root_order = (root.get("axis") or ["XYZ"])[0].upper()
    if sorted(root_order) != ["X", "Y", "Z"]:
        raise FormatError(f"{name}: the root's axis {root_order!r} is no order of axes as XYZ is")
    axes = [_turn(root_order, _floats(root, "orientation"), degrees)]
    axes += [_turn(bones[n].order, bones[n].axis, degrees) for n in order[1:]]
    channels = {n: bones[n].channels for n in order[1:] if bones[n].channels}
    channels[ROOT] = tuple(word.lower() for word in root.get("order", _ROOT_ORDER))
    unknown = [c for c in channels[ROOT] if c not in _ROTATIONS and c not in _TRANSLATIONS]
    if unknown:
        raise FormatError(f"{name}: the root's order has {unknown[0]!r}; it has tx ty tz rx ry rz")
    skeleton = Skeleton(
        tuple(order),
        tuple(parents),
        np.array(offsets),
        np.array(ends),
        # lengths are inches times the unit
        INCH / length,
    )
    return AsfSkeleton(
        skeleton, channels, np.array(axes), degrees, np.array(_floats(root, "position"))
    )


_ROOT_ORDER = ["tx", "ty", "tz", "rx", "ry", "rz"]


def _floats(root: dict[str, list[str]], key: str) -> tuple[float, ...]:
    return tuple(float(word) for word in root.get(key, ["0", "0", "0"]))


def _turn(order: str, angles: Sequence[float], degrees: bool) -> NDArray[np.float64]:
    """Return the matrix of an ``axis``: about the world's axes, the first of ``order`` first."""
    values = np.array(angles[::-1], dtype=np.float64)
    return euler(order[::-1], np.deg2rad(values) if degrees else values)


def parse_amc(data: bytes, asf: AsfSkeleton, name: str) -> Motion:
    """Read what is in an AMC file; ``name`` is what to call it."""
    lines = NumberedLines(data, name)
    degrees = asf.degrees
    values: dict[str, list[list[str]]] = {bone: [] for bone in asf.channels}
    number: dict[str, list[int]] = {bone: [] for bone in asf.channels}
    frames = 0
    for words in lines:
        first = words[0]
        if first.startswith(_NO_DATA):
            flag = first.upper()
            degrees = True if flag == ":DEGREES" else False if flag == ":RADIANS" else degrees
        elif len(words) == 1 and first.isdigit():
            if frames:
                _check_frame(lines, values, frames)
            frames += 1
        elif not frames:
            raise lines.error("has no frame number before its first values; it is no AMC file")
        else:
            wanted = asf.channels.get(first)
            if wanted is None:
                raise lines.error(
                    f"bone {first} cannot move or is not in the skeleton; give the right skeleton "
                    "(--skeleton)"
                )
            if len(words) - 1 != len(wanted):
                raise lines.error(
                    f"bone {first} has {len(words) - 1} values, the skeleton's has {len(wanted)}; "
                    "give the right skeleton (--skeleton)"
                )
            if len(values[first]) == frames:
                raise lines.error(f"bone {first} is there twice in one frame")
            values[first].append(words[1:])
            number[first].append(lines.line)
    if not frames:
        raise FormatError(f"{name}: has no frames; it is no whole AMC file; download it again")
    _check_frame(lines, values, frames)
    columns = {
        bone: _array(rows, number[bone], lines, bone) for bone, rows in values.items() if rows
    }
    return _motion(asf, columns, frames, degrees)


def _check_frame(lines: NumberedLines, values: dict[str, list[list[str]]], frames: int) -> None:
    """Raise an error where a bone that moved before has no values in the last frame."""
    for bone, rows in values.items():
        # some files leave out bones that never move
        if len(rows) != frames and (rows or bone == ROOT):
            raise lines.error(
                f"bone {bone} has no values in frame {frames} of the file, which ends before "
                "this line; the file is cut short or damaged, download it again"
            )


def _array(
    rows: list[list[str]], number: list[int], lines: NumberedLines, bone: str
) -> NDArray[np.float64]:
    """Return rows of words as numbers, all at once, and find the wrong one where that fails."""
    try:
        values = np.array(rows, dtype=np.float64)
        if (np.abs(values) <= GREATEST).all():
            return values
    except ValueError:
        pass
    for words, line in zip(rows, number, strict=True):
        lines.numbers(words, len(words), f"a value of bone {bone}", at=line)
    raise AssertionError("a number that is none was not found")


def _motion(
    asf: AsfSkeleton, columns: dict[str, NDArray[np.float64]], frames: int, degrees: bool
) -> Motion:
    """Turn values into turns and places."""
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
            # about the world's axes in the order of the file: the last one comes first
            at = [channels.index(c) for c in turning[::-1]]
            angles = np.deg2rad(values[:, at]) if degrees else values[:, at]
            local = euler("".join(_ROTATIONS[c] for c in turning[::-1]), angles)
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
    return Motion(skeleton, root, turns, moves)

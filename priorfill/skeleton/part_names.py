"""Names of body parts, and the joint names of known kinds of skeletons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from priorfill.errors import ClipError, MarkerSetError, PriorfillError
from priorfill.runtime.resources import resource_path
from priorfill.runtime.toml_file import read_toml

__all__ = [
    "FALLBACK_PARTS",
    "NEIGHBOURS",
    "PARTS",
    "SIDES",
    "TRUNK",
    "SkeletonKind",
    "find_joints",
    "skeleton_kinds",
]

SIDES = ("left", "right")

TRUNK = ("pelvis", "thorax", "head")
_LIMBS = (
    *("shoulder", "upper_arm", "forearm", "wrist", "hand"),
    *("thigh", "shank", "foot"),
)

PARTS = (*TRUNK, *(f"{side}_{limb}" for side in SIDES for limb in _LIMBS))
"""The parts of a body, named like the segments of marker sets. A part begins in a joint of the
skeleton and moves with it."""

FALLBACK_PARTS = {"wrist": "forearm"}
"""Parts of limbs that many skeletons lack, and the parts they then move with. The wrist, as in ASF,
is the lower part of the forearm, which rotates with the hand."""

_CHAIN = (
    *(("shoulder", "upper_arm"), ("upper_arm", "forearm"), ("forearm", "wrist"), ("wrist", "hand")),
    *(("thigh", "shank"), ("shank", "foot")),
)
NEIGHBOURS = tuple(
    pair
    for side in SIDES
    for pair in (
        ("thorax", f"{side}_shoulder"),
        ("pelvis", f"{side}_thigh"),
        *((f"{side}_{inner}", f"{side}_{outer}") for inner, outer in _CHAIN),
    )
)
"""Pairs of adjacent parts, between which skin stretches, from the trunk outwards."""


@dataclass(frozen=True)
class SkeletonKind:
    """A kind of skeleton.

    Attributes
    ----------
    name : str
        Its name.
    title : str
        Its description in one line.
    joints : dict of str to str
        The name of the joint of each part, except the thorax, whose joint is the parent of both
        shoulders.
    """

    name: str
    title: str
    joints: dict[str, str]


@lru_cache(maxsize=1)
def skeleton_kinds() -> tuple[SkeletonKind, ...]:
    """Return the kinds whose definitions are shipped with priorfill.

    Raises
    ------
    MarkerSetError
        If a definition is invalid.
    """
    return tuple(_read(file) for file in sorted(resource_path("skeletons", "kinds").glob("*.toml")))


def _read(file: Path) -> SkeletonKind:
    """Read a definition."""
    try:
        content = read_toml(file, MarkerSetError)
        parts, sides = dict(content["parts"]), dict(zip(SIDES, content["sides"], strict=True))
        joints = {part: str(parts.pop(part)) for part in TRUNK if part in parts}
        for limb, joint in parts.items():
            joints |= {f"{side}_{limb}": joint.replace("{s}", sides[side]) for side in SIDES}
        unknown = [part for part in joints if part not in PARTS]
        if unknown:
            raise ValueError(f"part {unknown[0]} is unknown")
        return SkeletonKind(str(content["name"]), str(content["title"]), joints)
    except PriorfillError:  # some are ValueErrors
        raise
    except (OSError, ValueError, KeyError, AttributeError) as error:
        raise MarkerSetError(
            f"{file}: is not a valid kind of skeleton ({error}); correct it"
        ) from error


def find_joints(
    names: Sequence[str], parents: Sequence[int], file: str
) -> tuple[SkeletonKind, dict[str, int]]:
    """Recognise a skeleton by the names of its joints.

    Parameters
    ----------
    names : sequence of str
        The joints' names; case and prefixes that end with a colon do not matter.
    parents : sequence of int
        The number of each joint's parent.
    file : str
        Name of the file for messages.

    Returns
    -------
    kind : SkeletonKind
        The kind.
    joints : dict of str to int
        The number of each part's joint, for the parts that the skeleton has.

    Raises
    ------
    ClipError
        If it is of no known kind.
    """
    numbers = {name.split(":")[-1].lower(): number for number, name in enumerate(names)}
    candidates = []
    for kind in skeleton_kinds():
        absent = [
            joint
            for part, joint in kind.joints.items()
            if joint.lower() not in numbers and not part.endswith(tuple(FALLBACK_PARTS))
        ]
        if not absent:
            joints = {
                part: numbers[joint.lower()]
                for part, joint in kind.joints.items()
                if joint.lower() in numbers
            }
            thorax = {parents[joints[f"{side}_shoulder"]] for side in SIDES}
            if len(thorax) == 1:
                joints["thorax"] = thorax.pop()
                return kind, joints
            absent = ["a common parent of both shoulders"]
        candidates.append((len(absent), kind.name, absent))
    _, nearest, absent = min(candidates)
    known = ", ".join(kind.name for kind in skeleton_kinds())
    raise ClipError(
        f"{file}: is a skeleton of no known kind ({known}); the most similar kind, {nearest}, also "
        f"has {', '.join(absent[:4])}; export it with these names"
    )

"""Kinds of skeletons: by what names their files call the parts of a body."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from priorfill.errors import ClipError, MarkerSetError
from priorfill.runtime.resources import resource_path

__all__ = ["BEFORE", "MIDDLE", "NEIGHBOURS", "PARTS", "SIDES", "Kind", "find_joints", "kinds"]

SIDES = ("left", "right")

MIDDLE = ("pelvis", "thorax", "head")
_LIMBS = (
    *("shoulder", "upper_arm", "forearm", "wrist", "hand"),
    *("thigh", "shank", "foot"),
)

PARTS = (*MIDDLE, *(f"{side}_{limb}" for side in SIDES for limb in _LIMBS))
"""The parts of a body, named as the segments of marker sets are. A part begins in a joint of the
skeleton and moves with it."""

BEFORE = {"wrist": "forearm"}
"""Parts of limbs that many skeletons do not have, and the parts that they then move with. Of the
wrist as ASF has it, the lower half of the forearm turns with the hand."""

_ALONG = (
    *(("shoulder", "upper_arm"), ("upper_arm", "forearm"), ("forearm", "wrist"), ("wrist", "hand")),
    *(("thigh", "shank"), ("shank", "foot")),
)
NEIGHBOURS = tuple(
    pair
    for side in SIDES
    for pair in (
        ("thorax", f"{side}_shoulder"),
        ("pelvis", f"{side}_thigh"),
        *((f"{side}_{one}", f"{side}_{other}") for one, other in _ALONG),
    )
)
"""Parts between which skin stretches: pairs, from the middle of the body outwards."""


@dataclass(frozen=True)
class Kind:
    """A kind of skeleton.

    Attributes
    ----------
    name : str
        How it is called.
    title : str
        What it is, in one line.
    joints : dict of str to str
        The name of the joint of each part; the thorax has none, it is what both shoulders hang
        on.
    """

    name: str
    title: str
    joints: dict[str, str]


@lru_cache(maxsize=1)
def kinds() -> tuple[Kind, ...]:
    """Return the kinds that ship with priorfill."""
    return tuple(_read(file) for file in sorted(resource_path("skeletons", "kinds").glob("*.toml")))


def _read(file: Path) -> Kind:
    """Read a definition."""
    try:
        content: dict[str, Any] = tomllib.loads(file.read_text(encoding="utf-8"))
        parts, sides = dict(content["parts"]), dict(zip(SIDES, content["sides"], strict=True))
        joints = {part: str(parts.pop(part)) for part in MIDDLE if part in parts}
        for limb, joint in parts.items():
            joints |= {f"{side}_{limb}": joint.replace("{s}", sides[side]) for side in SIDES}
        unknown = [part for part in joints if part not in PARTS]
        if unknown:
            raise ValueError(f"part {unknown[0]} is unknown")
        return Kind(str(content["name"]), str(content["title"]), joints)
    except (OSError, ValueError, KeyError, AttributeError) as error:
        raise MarkerSetError(f"{file}: is no kind of skeletons ({error}); correct it") from error


def find_joints(
    names: Sequence[str], parents: Sequence[int], file: str
) -> tuple[Kind, dict[str, int]]:
    """Recognise a skeleton by the names of its joints.

    Parameters
    ----------
    names : sequence of str
        The joints' names; upper and lower case, and what stands before a colon, do not matter.
    parents : sequence of int
        The number of each joint's parent.
    file : str
        What to call the file.

    Returns
    -------
    kind : Kind
        The kind.
    joints : dict of str to int
        The number of each part's joint; parts that it does not have are not among them.

    Raises
    ------
    ClipError
        Where it is of no kind that is known.
    """
    numbers = {name.split(":")[-1].lower(): number for number, name in enumerate(names)}
    found = []
    for kind in kinds():
        absent = [
            joint
            for part, joint in kind.joints.items()
            if joint.lower() not in numbers and not part.endswith(tuple(BEFORE))
        ]
        if not absent:
            joints = {
                part: numbers[joint.lower()]
                for part, joint in kind.joints.items()
                if joint.lower() in numbers
            }
            hung = {parents[joints[f"{side}_shoulder"]] for side in SIDES}
            if len(hung) == 1:
                joints["thorax"] = hung.pop()
                return kind, joints
            absent = ["one joint that both shoulders hang on"]
        found.append((len(absent), kind.name, absent))
    _, nearest, absent = min(found)
    raise ClipError(
        f"{file}: is a skeleton of no kind that is known ({', '.join(k.name for k in kinds())}); "
        f"{nearest} is nearest and has {', '.join(absent[:4])} too; export it with such names"
    )

"""What the name of a joint tells: the side of the body, and the parts it may begin."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["JointName", "read_names"]

_SIDES = {
    **dict.fromkeys(
        ("l", "left", "lft", "lt", "lf", "links", "gauche", "izq", "izquierda"), "left"
    ),
    **dict.fromkeys(("r", "right", "rgt", "rt", "rght", "rechts", "droite", "droit"), "right"),
    **dict.fromkeys(("der", "derecha"), "right"),
    **dict.fromkeys(("左",), "left"),
    **dict.fromkeys(("右",), "right"),
}
"""Words for the sides of the body."""

_NOISE = frozenset((
    *("joint", "jnt", "jt", "j", "bone", "bn", "b", "def", "bind", "bnd", "node", "rig", "m"),
    *("skel", "skeleton", "sk", "c", "ctrl", "mixamorig", "character", "bip", "biped", "bvh"),
))  # fmt: skip
"""Words that tell nothing about the part."""

_ENDS = frozenset(["end", "top", "nub", "tip", "site", "effector", "eff", "endsite", "terminal"])
"""Words for the end of a bone, which begins no part."""

_LEG_WORDS = {
    "hip": ("hip_joint", "thigh"),
    **dict.fromkeys(("hipjoint", "buttock", "glute", "pelvis"), ("hip_joint",)),
    **dict.fromkeys(("thigh", "upleg", "upperleg", "legupper", "femur", "uleg"), ("thigh",)),
    "leg": ("shank", "thigh"),
    **dict.fromkeys(
        ("shin", "shank", "calf", "tibia", "knee", "lowleg", "lowerleg", "leglower", "foreleg"),
        ("shank",),
    ),
    **dict.fromkeys(("foot", "ankle", "feet"), ("foot",)),
    **dict.fromkeys(("toe", "toes", "toebase", "ball", "forefoot"), ("toe",)),
}
_ARM_WORDS = {
    **dict.fromkeys(("clavicle", "collar", "collarbone", "clav", "scapula"), ("shoulder",)),
    "shoulder": ("shoulder", "upper_arm"),
    **dict.fromkeys(
        ("upperarm", "uparm", "armupper", "humerus", "shldr", "bicep", "uarm"), ("upper_arm",)
    ),
    "arm": ("upper_arm", "forearm"),
    **dict.fromkeys(
        ("forearm", "lowerarm", "lowarm", "armlower", "elbow", "radius", "ulna", "farm"),
        ("forearm",),
    ),
    "wrist": ("wrist", "hand"),
    **dict.fromkeys(("hand", "palm"), ("hand",)),
    **dict.fromkeys(("thumb", "handthumb", "thumbproximal"), ("thumb",)),
}
_MIDDLE_WORDS = {
    **dict.fromkeys(("head", "skull"), ("head",)),
    "neck": ("neck",),
    **dict.fromkeys(("eye", "eyeball"), ("eye",)),
}
_WORDS = _LEG_WORDS | _ARM_WORDS
_GLUED = re.compile(
    r"(left|right|l|r)(" + "|".join(sorted(_WORDS, key=len, reverse=True)) + r")s?\d*"
)
_SPLIT = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_a-zA-Z]+")
"""Words of a name: ``lShldr`` is l, Shldr; ``L_UpLeg01`` is L, Up, Leg, 01."""


_VERTEBRA = re.compile(r"[LTC]\d+")
"""Vertebrae: L5 is no left joint."""

_SHORT = re.compile(r"(?<![A-Za-z])([LR])([UFL])(?=Arm|Leg)")
_SHORT_WORDS = {"U": "Upper", "F": "Fore", "L": "Lower"}
"""LUArm is the left upper arm."""


@dataclass(frozen=True)
class JointName:
    """A joint's name, read.

    Attributes
    ----------
    side : str
        ``"left"``, ``"right"`` or empty.
    parts : tuple of str
        The parts that the joint may begin, the likeliest first; also ``hip_joint``, ``toe``,
        ``thumb``, ``eye`` and ``neck``, which are no parts of their own.
    is_end : bool
        Whether it names the end of a bone.
    """

    side: str
    parts: tuple[str, ...]
    is_end: bool = False


def read_names(names: Sequence[str]) -> list[JointName]:
    """Read the names of a skeleton's joints.

    Prefixes that end with a colon, and words that most names begin with, are ignored.

    Parameters
    ----------
    names : sequence of str
        The names.

    Returns
    -------
    list of JointName

    Examples
    --------
    >>> read_names(["mixamorig:LeftUpLeg", "lfemur", "Shoulder_R"])[2]
    JointName(side='right', parts=('shoulder', 'upper_arm'), is_end=False)
    """
    split = [_split(name) for name in names]
    first = Counter(words[0] for words in split if len(words) > 1)
    shared = {
        word for word, count in first.items() if count > len(names) / 2 and word not in _SIDES
    }
    return [_read(words[1:] if words and words[0] in shared else words) for words in split]


def _split(name: str) -> list[str]:
    """Return the words of a name in lower case, without numbers."""
    if _VERTEBRA.fullmatch(name):
        return []
    name = _SHORT.sub(lambda match: f"{match[1]}_{_SHORT_WORDS[match[2]]}", name)
    words = [word.lower() for word in _SPLIT.findall(name.split(":")[-1].split("|")[-1])]
    return [word for word in words if not word.isdigit()]


def _read(words: list[str]) -> JointName:
    side = ""
    kept: list[str] = []
    for word in words:
        glued = None if word in _WORDS else _GLUED.fullmatch(word)
        if glued and not side:
            side = _SIDES[glued[1]]
            kept.append(glued[2])
        elif word in _SIDES and not side:
            side = _SIDES[word]
        elif word[:1] in "左右" and not side:
            side = _SIDES[word[0]]
        elif word not in _NOISE:
            kept.append(word)
    is_end = any(word in _ENDS for word in kept)
    text = "".join(word for word in kept if word not in _ENDS)
    return JointName(side, _parts(text), is_end)


def _parts(text: str) -> tuple[str, ...]:
    for words in (_WORDS, _MIDDLE_WORDS):
        for form in (text, text.removesuffix("s")):
            if form in words:
                return words[form]
    return ()

"""Names of body parts."""

from __future__ import annotations

__all__ = ["LIMBS", "NEIGHBOURS", "PARTS", "SIDES", "TRUNK"]

SIDES = ("left", "right")

TRUNK = ("pelvis", "thorax", "head")
LIMBS = (
    *("shoulder", "upper_arm", "forearm", "wrist", "hand"),
    *("thigh", "shank", "foot"),
)

PARTS = (*TRUNK, *(f"{side}_{limb}" for side in SIDES for limb in LIMBS))
"""The parts of a body, named like the segments of marker sets. A part begins in a joint of the
skeleton and moves with it."""

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

"""Find the joints of a body in a skeleton, by their names, the tree of joints, and bone lengths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import ClipError
from priorfill.skeleton.joint_names import JointName, read_names
from priorfill.skeleton.joints import Skeleton
from priorfill.skeleton.part_names import PARTS, SIDES

__all__ = ["BodyJoints", "find_joints"]

MAX_LIMB_JOINTS = 24
"""Joints of a limb that are looked at, from the trunk outwards; real ones have up to ten."""

MIN_PAIR_RATIO = 0.85
"""Lengths of two subtrees, shorter to longer, that may be a left and a right limb."""

MIN_LIMB_SHARE = 0.3
"""Length of a limb relative to the longest one: shorter pairs are eyes, ears or feet."""

SKIPPED_JOINT = 0.5
"""Loss of fit for each joint inside the two long bones of a limb, such as one that only twists."""

ALIKE_BONUS = 0.5
"""Gain of a pair of branches with equally many joints, in units of the ratio of their lengths."""

MIN_SIDED_PARTS, MIN_SIDED_JOINTS = 3, 6
"""Joints of each side whose names state the side and a part, or only the side, that are needed for
left and right to count as known."""

FIT_LIKELIEST, FIT_POSSIBLE, FIT_SHOULDER = 3.0, 2.5, 1.0
"""Fit of a joint for a part that its name likeliest means, or may mean; of a shoulder for an upper
arm, since it is more often a clavicle. A joint whose name tells no part has a fit of 0."""

FIT_OTHER, FIT_END = -3.0, -4.0
"""Fit of a joint that is named after another part, or as the end of a bone."""

RATIO_LOSS = 2.0
"""Loss of fit where the ratio of the two long bones is e times the usual one, or 1/e."""

EVEN_GAIN = 4.0
"""Gain of fit for the shorter of the two long bones, as a share of the limb."""

MAX_NAMES_SHOWN = 12
"""Names of joints that an error message lists."""

_LIMBS = {
    "leg": (("thigh", "shank", "foot"), 1.0),
    "arm": (("upper_arm", "forearm", "hand"), 0.95),
}
"""Parts of a limb, and the usual length of its second bone relative to the first."""

_LIMB_PARTS = {
    "leg": {"hip_joint", "thigh", "shank", "foot", "toe"},
    "arm": {"shoulder", "upper_arm", "forearm", "wrist", "hand", "thumb"},
}
_REQUIRED = ("head", *(f"{s}_{p}" for parts, _ in _LIMBS.values() for p in parts for s in SIDES))


@dataclass(frozen=True)
class BodyJoints:
    """The joints of a body.

    Attributes
    ----------
    parts : dict of str to int
        The number of each part's joint; a wrist or shoulder may be absent.
    tips : dict of str to int
        The number of the joint where the bone of a foot or a hand ends, of the top of the head, of
        thumbs (``left_thumb``) and eyes (``left_eye``); absent where the skeleton has none.
    sides_named : bool
        Whether left and right are known from names or from the user; otherwise they are any.
    """

    parts: dict[str, int]
    tips: dict[str, int]
    sides_named: bool

    def numbered(self, joints: Sequence[int]) -> BodyJoints:
        """Return the same joints, numbered by their places in a sequence."""
        number = {joint: k for k, joint in enumerate(joints)}
        return BodyJoints(
            {part: number[joint] for part, joint in self.parts.items()},
            {part: number[joint] for part, joint in self.tips.items()},
            self.sides_named,
        )

    def exchanged(self, *limbs: str) -> BodyJoints:
        """Return the same joints with left and right exchanged in some parts of limbs."""
        other = dict(zip((f"{s}_" for s in SIDES), (f"{s}_" for s in SIDES[::-1]), strict=True))

        def swap(part: str) -> str:
            side, _, limb = part.partition("_")
            return other.get(f"{side}_", f"{side}_") + limb if limb in limbs else part

        return BodyJoints(
            {swap(part): joint for part, joint in self.parts.items()},
            {swap(part): joint for part, joint in self.tips.items()},
            self.sides_named,
        )


class _Tree:
    """A skeleton's tree of joints, with lengths and names."""

    def __init__(self, skeleton: Skeleton, lengths: NDArray[np.float64]) -> None:
        self.parents = skeleton.parents
        self.names = read_names(skeleton.names)
        self.lengths = lengths
        count = len(self.parents)
        self.children: list[list[int]] = [[] for _ in range(count)]
        self.depth = [0] * count
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                self.children[parent].append(joint)
                self.depth[joint] = self.depth[parent] + 1
        self.reach = np.zeros(count)  # length of the longest path below a joint
        for joint in range(count - 1, 0, -1):
            if (parent := self.parents[joint]) >= 0:
                below = self.reach[joint] + lengths[joint]
                self.reach[parent] = max(self.reach[parent], below)

    def path(self, joint: int) -> list[int]:
        """Return the joints from the root to a joint."""
        found = [joint]
        while (parent := self.parents[found[-1]]) >= 0:
            found.append(parent)
        return found[::-1]

    def below(self, top: int) -> list[int]:
        """Return a joint and all below it, parents before children."""
        found = [top]
        for joint in found:  # grows in the loop
            found += self.children[joint]
        return found

    def common(self, one: int, other: int) -> int:
        """Return the last joint that the paths to two joints share; -1 if there is none."""
        shared = [a for a, b in zip(self.path(one), self.path(other), strict=False) if a == b]
        return shared[-1] if shared else -1


def find_joints(
    skeleton: Skeleton,
    lengths: NDArray[np.float64],
    file: str,
    given: Mapping[str, str] | None = None,
) -> BodyJoints:
    """Find the joints of a body.

    Names are read word by word (`priorfill.skeleton.joint_names`). What names leave open is found
    from the tree: legs and arms are pairs of long branches, the legs nearer the root, and their
    two long bones are of similar length.

    Parameters
    ----------
    skeleton : Skeleton
        The skeleton.
    lengths : ndarray [shape=(joints,), any unit]
        Distance of each joint from its parent.
    file : str
        Name of the file for messages.
    given : mapping of str to str, optional
        Names of joints by part, which take precedence.

    Returns
    -------
    BodyJoints

    Raises
    ------
    ClipError
        If some are not found, or a given one does not exist.
    """
    tree = _Tree(skeleton, lengths)
    fixed = _given_joints(skeleton, given or {}, file)
    sides, named = _sides(tree)
    parts: dict[str, int] = {}
    tips: dict[str, int] = {}
    for side in SIDES:
        for kind, top in _limb_tops(tree, sides, side).items():
            parts |= _limb(tree, top, kind, side)
    parts |= fixed
    _add_trunk(tree, parts, sides, fixed)
    missing = [part for part in _REQUIRED if part not in parts]
    if missing:
        raise ClipError(_missing_text(file, missing, skeleton.names))
    _add_tips(tree, parts, tips)
    _add_thumbs_and_eyes(tree, parts, tips)
    named = named or any(part.startswith(SIDES) for part in fixed)
    return BodyJoints(parts, tips, named)


def _missing_text(file: str, missing: Sequence[str], names: Sequence[str]) -> str:
    shown = ", ".join(repr(name)[1:-1] for name in names[:MAX_NAMES_SHOWN])
    more = ", ..." if len(names) > MAX_NAMES_SHOWN else ""
    return (
        f"{file}: no joint is recognised as {', '.join(missing[:4])}"
        f"{', ...' if len(missing) > 4 else ''} among {shown}{more}; name them (`joints`), in a "
        f'file with a line [parts] and lines such as {missing[0]} = "NAME OF THE JOINT"'
    )


def _given_joints(skeleton: Skeleton, given: Mapping[str, str], file: str) -> dict[str, int]:
    """Return the numbers of joints that the user names."""
    found = {}
    lower = [name.lower() for name in skeleton.names]
    for part, name in given.items():
        if part not in PARTS:
            raise ClipError(
                f"{file}: part {part!r} of `joints` is unknown; use some of {', '.join(PARTS)}"
            )
        count = lower.count(name.lower())
        if count != 1:
            raise ClipError(
                f"{file}: {'two joints are' if count else 'no joint is'} named {name!r}, which "
                f"`joints` gives for {part}; correct the name"
            )
        found[part] = lower.index(name.lower())
    return found


def _sides(tree: _Tree) -> tuple[list[str], bool]:
    """Return the side of each joint, and whether names tell it.

    Joints below one of a side belong to that side. If names do not tell, sides are those of pairs
    of similar branches.
    """
    sides = [name.side for name in tree.names]
    named = all(
        sum(side == one and bool(name.parts) for side, name in zip(sides, tree.names, strict=True))
        >= MIN_SIDED_PARTS
        or sides.count(one) >= MIN_SIDED_JOINTS
        for one in SIDES
    )
    if not named:
        sides = _paired_sides(tree)
    for joint, parent in enumerate(tree.parents):
        if parent >= 0 and sides[parent] and not sides[joint]:
            sides[joint] = sides[parent]
    for joint in range(len(sides) - 1, 0, -1):
        # a nameless joint that carries one side alone
        below = {sides[child] for child in tree.children[joint]}
        if not sides[joint] and not tree.names[joint].parts and len(below) == 1:
            sides[joint] = below.pop()
    return sides, named


def _paired_sides(tree: _Tree) -> list[str]:
    """Return sides of pairs of branches of similar length that begin in one joint."""
    sides = [""] * len(tree.parents)
    longest = tree.reach.max(initial=0.0)
    for joint, children in enumerate(tree.children):
        if any(sides[above] for above in tree.path(joint)):
            continue
        branches = sorted(children, key=lambda c: -(tree.reach[c] + tree.lengths[c]))
        whole = {c: tree.reach[c] + tree.lengths[c] for c in branches}
        best: tuple[float, int, int] | None = None
        for i, one in enumerate(branches):
            for other in branches[i + 1 :]:
                if whole[one] < MIN_LIMB_SHARE * longest:
                    continue
                ratio = whole[other] / whole[one]
                alike = len(tree.below(one)) == len(tree.below(other))
                score = ratio + (ALIKE_BONUS if alike else 0.0)
                if ratio >= MIN_PAIR_RATIO and (best is None or score > best[0]):
                    best = (score, one, other)
        if best is not None:
            sides[best[1]], sides[best[2]] = SIDES
    return sides


def _limb_tops(tree: _Tree, sides: Sequence[str], side: str) -> dict[str, int]:
    """Return the first joints of the leg and of the arm of a side."""
    tops = [
        joint
        for joint, parent in enumerate(tree.parents)
        if sides[joint] == side and (parent < 0 or sides[parent] != side)
    ]
    votes = {}
    for top in tops:
        found = [set(tree.names[joint].parts) for joint in tree.below(top)]
        votes[top] = {
            kind: sum(bool(parts & own) for parts in found) for kind, own in _LIMB_PARTS.items()
        }
    chosen: dict[str, int] = {}
    for kind, other in (("leg", "arm"), ("arm", "leg")):
        voted = [top for top in tops if votes[top][kind] > votes[top][other]]
        if voted:
            chosen[kind] = max(voted, key=lambda top: (votes[top][kind], tree.reach[top]))
    rest = sorted(
        (top for top in tops if top not in chosen.values() and not any(votes[top].values())),
        key=lambda top: -tree.reach[top],
    )
    if not chosen and len(rest) >= 2:
        # the legs begin nearer the root
        first = sorted(rest[:2], key=lambda top: (tree.depth[top], -tree.reach[top]))
        return {"leg": first[0], "arm": first[1]}
    for kind in _LIMBS:
        if kind not in chosen and rest:
            chosen[kind] = rest.pop(0)
    return chosen


def _limb(tree: _Tree, top: int, kind: str, side: str) -> dict[str, int]:
    """Return the joints of a limb: those that fit best by name and length."""
    roles, usual = _LIMBS[kind]
    along = {joint: _ancestors(tree, joint, top) for joint in tree.below(top)}
    total = float(tree.reach[top])
    best: tuple[float, tuple[int, int, int]] | None = None
    for last, path in along.items():
        if len(path) > MAX_LIMB_JOINTS:
            continue
        at = np.cumsum([0.0, *(tree.lengths[joint] for joint in path[1:])])
        ends = _fit(tree.names[last], roles[2])
        for j in range(1, len(path) - 1):
            middle = ends + _fit(tree.names[path[j]], roles[1])
            for i in range(j):
                upper, lower = at[j] - at[i], at[-1] - at[j]
                if min(upper, lower) <= 0.0:
                    continue
                score = middle + _fit(tree.names[path[i]], roles[0])
                score -= RATIO_LOSS * abs(float(np.log(lower / upper / usual)))
                score += EVEN_GAIN * min(upper, lower) / total
                score -= SKIPPED_JOINT * (len(path) - 3 - i)
                if best is None or score > best[0]:
                    best = (score, (path[i], path[j], last))
    if best is None:
        return {}
    parts = {f"{side}_{role}": joint for role, joint in zip(roles, best[1], strict=True)}
    if kind == "arm":
        path = along[best[1][2]]
        before = path[: path.index(best[1][0])]
        collars = [joint for joint in before if "shoulder" in tree.names[joint].parts]
        if collars or before:
            parts[f"{side}_shoulder"] = (collars or before)[-1]
        between = path[path.index(best[1][1]) + 1 : -1]
        wrists = [joint for joint in between if "wrist" in tree.names[joint].parts]
        if wrists:
            parts[f"{side}_wrist"] = wrists[0]
    return parts


def _ancestors(tree: _Tree, joint: int, top: int) -> list[int]:
    """Return the joints from a joint above to a joint."""
    path = tree.path(joint)
    return path[path.index(top) :]


def _fit(name: JointName, role: str) -> float:
    """Return how well a name fits a part."""
    if name.is_end:
        return FIT_END
    if not name.parts:
        return 0.0
    if role not in name.parts:
        return FIT_OTHER
    if role == name.parts[0]:
        return FIT_LIKELIEST
    return FIT_SHOULDER if role == "upper_arm" else FIT_POSSIBLE


def _add_trunk(
    tree: _Tree, parts: dict[str, int], sides: Sequence[str], fixed: Mapping[str, int]
) -> None:
    """Add pelvis, thorax and head: the joints common to both legs, to both arms, and the third."""
    for trunk, limb in (("pelvis", "thigh"), ("thorax", "upper_arm")):
        ends = [parts.get(f"{side}_{limb}") for side in SIDES]
        if trunk not in fixed and ends[0] is not None and ends[1] is not None:
            common = tree.common(ends[0], ends[1])
            if common >= 0:
                parts[trunk] = common
    for side in SIDES:
        if "thorax" in parts:
            parts.setdefault(f"{side}_shoulder", parts["thorax"])
    if "head" in fixed or "thorax" not in parts:
        return
    limbs = {joint for part, joint in parts.items() if part.startswith(SIDES)}
    open_joints = [
        joint
        for joint in range(len(tree.parents))
        if not sides[joint] and joint not in limbs and not tree.names[joint].is_end
    ]
    for part in ("head", "neck"):
        named = [joint for joint in open_joints if part in tree.names[joint].parts]
        if named:
            nearest = min if part == "head" else max
            parts["head"] = nearest(named, key=lambda joint: tree.depth[joint])
            return
    branches = [c for c in tree.children[parts["thorax"]] if c in open_joints]
    if branches:
        joint = max(branches, key=lambda c: tree.reach[c] + tree.lengths[c])
        while below := [c for c in tree.children[joint] if c in open_joints]:
            if len(below) > 1:
                break
            joint = below[0]
        parts["head"] = joint


def _add_tips(tree: _Tree, parts: Mapping[str, int], tips: dict[str, int]) -> None:
    """Add the joints where feet, hands and the head end."""
    for part in ("head", *(f"{side}_{end}" for side in SIDES for end in ("foot", "hand"))):
        children = [c for c in tree.children[parts[part]] if tree.lengths[c] > 0.0]
        if part == "head":
            children = [c for c in children if tree.names[c].is_end]
        elif part.endswith("foot"):
            toes = [c for c in children if "toe" in tree.names[c].parts]
            children = toes or children
        if len(children) == 1 or (children and part.endswith("foot")):
            tips[part] = max(children, key=lambda c: tree.reach[c] + tree.lengths[c])


def _add_thumbs_and_eyes(tree: _Tree, parts: Mapping[str, int], tips: dict[str, int]) -> None:
    """Add the first joints of the thumbs, and the eyes, if both sides have them."""
    for part in ("thumb", "eye"):
        found = {}
        for side in SIDES:
            above = parts["head"] if part == "eye" else parts[f"{side}_forearm"]
            found[side] = [
                joint
                for joint in tree.below(above)
                if part in tree.names[joint].parts
                and not tree.names[joint].is_end
                and tree.names[joint].side in ("", side)
            ]
        if all(len(joints) >= 1 for joints in found.values()) and found["left"] != found["right"]:
            tips |= {f"{side}_{part}": joints[0] for side, joints in found.items()}

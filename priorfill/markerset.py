"""Marker sets: on which segment each marker sits, and which are fit for the search.

A set comes from a definition file (``database/markersets/README.md`` describes its form), or,
for a clip that fits none, from the clip's own data.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.distances import pair_distances
from priorfill.errors import MarkerSetError
from priorfill.rigid import MIN_COMMON, rigid_groups
from priorfill.shipped import shipped

__all__ = [
    "DISCOVERED",
    "MarkerSet",
    "available",
    "describe",
    "discover",
    "load",
    "recognise",
    "same_markers",
]

DISCOVERED = "discovered"
"""Name of a set that was found from the data."""

MIN_SET_SHARE = 0.4
"""A set is recognised if at least this share of its markers is in the clip: the legs of a
full-body set, 16 of 39 markers, still count."""

MIN_CLIP_SHARE = 0.6
"""A set is recognised if it knows at least this share of the clip's markers."""

MIN_COMPANIONS = 2
"""Other markers that a segment needs for a marker's place on it to be known; three markers
also make the smallest frame of reference."""

FIRM = 5.0
"""mm. A marker sits firmly if its distances to the other markers of its segment vary by no more
than this (root mean square). Half of the pairs of one known segment do so in real takes."""

MIN_RELIABLE = 6
"""Where fewer markers than this are reliable by the data, all that are mostly seen count: with
fewer, most of the body's posture would have no say in the search."""

CENTRAL = 0.5
"""Distance of a segment from the body's middle, relative to the markers' mean distance, at which
it loses half its credit as a root: pelvis and thorax are nearer, head and limbs farther off."""

MOSTLY_SEEN = 0.5
"""Share of the frames in which a marker must be seen to count as reliable."""

ENV_FOLDER = "PRIORFILL_MARKERSETS"
"""Environment variable that names a folder with a user's definitions."""

JOINT_POINTS = 3
"""Points of an angle: above the joint, the joint, below it."""

MIRROR_RULE = "L/R"
"""The mirror rule of definition files: L... and R... are mirror images."""

_KEYS = {
    *("name", "title", "source", "root_segments", "mirror", "midline", "markers", "aliases"),
    "joints",
}
_MARKER_KEYS = {"segment", "reliable", "optional"}
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


Joint = tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]
"""Markers of three points, the middle one at the joint."""


@dataclass(frozen=True)
class MarkerSet:
    """What is known of a set of markers.

    Attributes
    ----------
    name : str
        How the set is called; `DISCOVERED` if it was found from the data.
    labels : tuple of str
        The markers.
    segment : dict of str to str
        The body segment of each marker.
    reliable : dict of str to bool
        Which markers are placed the same way on everybody and so are fit for the search.
    mirror : dict of str to str
        The mirror image of each marker that has one; a marker in the middle is its own.
    root_segments : tuple of str
        Segments that can carry the root frame, best first.
    title : str
        One line on what the set is.
    source : str
        Where the definition is from.
    aliases : dict of str to str
        Other spellings and the labels they stand for.
    optional : frozenset of str
        Markers that a clip of this set need not have.
    joints : dict of str to three tuples of str
        Angles to compare fills by: the markers whose mean is the first point, the joint, and the
        last point.
    """

    name: str
    labels: tuple[str, ...]
    segment: dict[str, str]
    reliable: dict[str, bool]
    mirror: dict[str, str]
    root_segments: tuple[str, ...]
    title: str = ""
    source: str = ""
    aliases: dict[str, str] = field(default_factory=dict)
    optional: frozenset[str] = frozenset()
    joints: dict[str, Joint] = field(default_factory=dict)

    @property
    def segments(self) -> dict[str, tuple[str, ...]]:
        """The markers of each segment, in the order of `labels`."""
        result: dict[str, list[str]] = {}
        for label in self.labels:
            result.setdefault(self.segment[label], []).append(label)
        return {segment: tuple(labels) for segment, labels in result.items()}

    def match(self, labels: Sequence[str]) -> dict[str, str]:
        """Return which of `labels` this set knows, and as which of its markers.

        Upper and lower case are the same; an alias counts only where the marker is not there
        under its own label. No marker of the set is given twice.
        """
        known = {label.upper(): label for label in self.labels}
        result: dict[str, str] = {}
        taken: set[str] = set()
        other = {alias.upper(): label for alias, label in self.aliases.items()}
        for names in (known, other):
            for label in labels:
                name = names.get(label.upper())
                if name is not None and label not in result and name not in taken:
                    result[label] = name
                    taken.add(name)
        return {label: result[label] for label in labels if label in result}


def load(name_or_path: str | Path) -> MarkerSet:
    """Return a marker set by name, or read it from a definition file.

    Parameters
    ----------
    name_or_path : str or Path
        Name of one of `available`, or the path of a ``.toml`` file.

    Raises
    ------
    MarkerSetError
        Where there is no such set, or its definition is malformed.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml" or len(path.parts) > 1:
        return _read(path)
    sets = available()
    if str(name_or_path) not in sets:
        raise MarkerSetError(
            f"marker set {name_or_path} is unknown; use one of {', '.join(sorted(sets))}, "
            "or the path of a definition file"
        )
    return sets[str(name_or_path)]


def available() -> dict[str, MarkerSet]:
    """Return every marker set that is found, by name; a user's go before shipped ones.

    Raises
    ------
    MarkerSetError
        Where a definition is malformed, or the folder named by `PRIORFILL_MARKERSETS` is not
        there.
    """
    sets: dict[str, MarkerSet] = {}
    for folder in _folders():
        here: dict[str, Path] = {}
        for path in sorted(folder.glob("*.toml")):
            markerset = _read(path)
            if markerset.name in here:
                raise MarkerSetError(
                    f"{path}: has the name {markerset.name} of {here[markerset.name].name}; "
                    "give it another one"
                )
            here[markerset.name] = path
            sets.setdefault(markerset.name, markerset)
    return sets


def recognise(labels: Sequence[str]) -> MarkerSet | None:
    """Return the marker set that a clip's labels belong to.

    The one that shares the most with the clip (Dice coefficient), if it knows at least
    `MIN_CLIP_SHARE` of the clip's markers and at least `MIN_SET_SHARE` of its own, optional ones
    apart, are in the clip.

    Parameters
    ----------
    labels : sequence of str
        The clip's labels without subject prefix.

    Returns
    -------
    MarkerSet or None
        As defined, with all its markers; None where nothing fits.

    Raises
    ------
    MarkerSetError
        Where a definition file is malformed.
    """
    best: MarkerSet | None = None
    best_score = 0.0
    for _, markerset in sorted(available().items()):
        match = markerset.match(labels)
        needed = [label for label in markerset.labels if label not in markerset.optional]
        found = sum(label not in markerset.optional for label in match.values())
        if found < MIN_SET_SHARE * len(needed) or len(match) < MIN_CLIP_SHARE * len(labels):
            continue
        score = 2 * found / (len(needed) + len(labels))
        if score > best_score:
            best, best_score = markerset, score
    return best


def same_markers(
    labels: Sequence[str], others: Sequence[str], marker_set: MarkerSet | None
) -> tuple[list[int], list[int]]:
    """Find which markers of two recordings are the same.

    The same label is the same marker; where the marker set knows both, so are upper and lower
    case and the other spellings that it lists.

    Parameters
    ----------
    labels, others : sequence of str
        The markers of the two recordings.
    marker_set : MarkerSet or None
        As defined, with its other spellings.

    Returns
    -------
    here, there : list of int
        Indices into `labels` and `others` of the markers that both have, pair by pair.
    """
    mine, theirs = {label: label for label in labels}, {label: label for label in others}
    if marker_set is not None:
        mine |= marker_set.match(labels)
        theirs |= marker_set.match(others)
    place = {name: others.index(label) for label, name in theirs.items()}
    here = [i for i, label in enumerate(labels) if mine[label] in place]
    return here, [place[mine[labels[i]]] for i in here]


def discover(positions: NDArray[np.floating], labels: Sequence[str]) -> MarkerSet:
    """Return a marker set found from the data alone.

    Segments are groups of markers whose mutual distances hardly vary (`rigid_groups`). A marker
    is reliable if it is mostly seen and sits firmly (`FIRM`) on a segment with at least
    `MIN_COMPANIONS` others; if that leaves fewer than `MIN_RELIABLE`, every marker that is
    mostly seen is. Root segments have three markers or more and come in order of how often
    they are whole, how large, rigid and central they are. Mirror images are told by the names, if
    at least half of the labels come in pairs of a left and a right one.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    labels : sequence of str
        One for each marker, unique.

    Returns
    -------
    MarkerSet
        With the name `DISCOVERED` and segments ``segment01``, ``segment02``, ... in the order
        of their first markers.
    """
    spread = pair_distances(positions, MIN_COMMON)[1]
    groups = rigid_groups(spread)
    names = [f"segment{i + 1:02d}" for i in range(len(groups))]
    segment = {labels[m]: name for name, group in zip(names, groups, strict=True) for m in group}

    seen = ~np.isnan(positions[:, :, 0])
    mostly_seen = seen.mean(axis=0) >= MOSTLY_SEEN if len(seen) else np.zeros(len(labels), bool)
    firm = np.zeros(len(labels), dtype=bool)
    for group in groups:
        if len(group) > MIN_COMPANIONS:
            inner = spread[np.ix_(group, group)]
            firm[group] = np.sqrt((inner**2).sum(axis=1) / (len(group) - 1)) <= FIRM
    reliable = firm & mostly_seen
    if reliable.sum() < MIN_RELIABLE:
        reliable = mostly_seen

    order = sorted(range(len(groups)), key=_root_fitness(positions, spread, groups), reverse=True)
    frames = [i for i in order if len(groups[i]) > MIN_COMPANIONS]
    return MarkerSet(
        name=DISCOVERED,
        labels=tuple(labels),
        segment={label: segment[label] for label in labels},
        reliable={label: bool(reliable[m]) for m, label in enumerate(labels)},
        mirror=_mirror_by_names(labels),
        root_segments=tuple(names[i] for i in frames or order),
        title="found from the data",
    )


def describe(clip: Clip, markerset: MarkerSet | None = None) -> MarkerSet:
    """Return the marker set of a clip: exactly its markers, under its own labels.

    Parameters
    ----------
    clip : Clip
        The clip.
    markerset : MarkerSet, optional
        The set it belongs to; by default the one that its labels are recognised as.

    Returns
    -------
    MarkerSet
        The set with what the clip does not have taken out. Markers that the set does not know
        are put on the segment to which their distances stay the most constant, as not reliable
        and without mirror image. If no set fits, what `discover` finds.

    Raises
    ------
    MarkerSetError
        Where a definition file is malformed.
    """
    markerset = markerset or recognise(clip.labels)
    if markerset is None:
        return discover(clip.positions, clip.labels)
    match = markerset.match(clip.labels)
    own = {name: label for label, name in match.items()}
    segment = {label: markerset.segment[name] for label, name in match.items()}
    extra = [label for label in clip.labels if label not in match]
    if extra:
        segment |= _nearest_segments(clip, segment, extra)
    present = set(segment.values())
    return MarkerSet(
        name=markerset.name,
        labels=clip.labels,
        segment={label: segment[label] for label in clip.labels},
        reliable={
            label: label in match and markerset.reliable[match[label]] for label in clip.labels
        },
        mirror={
            label: own[markerset.mirror[name]]
            for label, name in match.items()
            if markerset.mirror.get(name) in own
        },
        root_segments=tuple(s for s in markerset.root_segments if s in present),
        title=markerset.title,
        source=markerset.source,
        joints={
            joint: cast(Joint, tuple(tuple(own[name] for name in point) for point in points))
            for joint, points in markerset.joints.items()
            if all(name in own for point in points for name in point)
        },
    )


def _nearest_segments(
    clip: Clip, segment: Mapping[str, str], extra: Sequence[str]
) -> dict[str, str]:
    """Return a segment for each extra marker; its own label where none was seen with it."""
    spread = pair_distances(clip.positions, MIN_COMMON)[1]
    index = {label: m for m, label in enumerate(clip.labels)}
    members: dict[str, list[int]] = {}
    for label, name in segment.items():
        members.setdefault(name, []).append(index[label])
    result = {}
    for label in extra:
        mean = {name: float(spread[index[label], group].mean()) for name, group in members.items()}
        name = min(mean, key=lambda key: mean[key])
        result[label] = name if np.isfinite(mean[name]) else label
    return result


def _root_fitness(
    positions: NDArray[np.floating], spread: NDArray[np.float64], groups: list[list[int]]
) -> Callable[[int], float]:
    """Return the sort key of `groups`: how fit each is to carry the root frame.

    A product, so that a group which fails in one respect does not come first: the share of
    frames in which it is whole, its size (up to 4 markers; more add nothing), how rigid and how
    central it is. Half the credit is lost at a spread of `FIRM`, and at `CENTRAL` times the
    markers' mean distance from the body's middle; the square keeps limbs behind the trunk.
    """
    seen = ~np.isnan(positions[:, :, 0])
    step = max(1, positions.shape[0] // 100)
    data = np.asarray(positions[::step], dtype=np.float64)
    known = ~np.isnan(data[:, :, :1])
    filled = np.where(known, data, 0.0)
    middle = filled.sum(axis=1, keepdims=True) / np.maximum(known.sum(axis=1, keepdims=True), 1)
    distance = np.where(known[:, :, 0], np.linalg.norm(filled - middle, axis=2), 0.0)
    distance = distance.sum(axis=0) / np.maximum(known[:, :, 0].sum(axis=0), 1)
    body = max(float(distance.mean()), 1e-9)

    def fitness(i: int) -> float:
        group = groups[i]
        whole = float(seen[:, group].all(axis=1).mean()) if len(seen) else 0.0
        size = min(len(group), 4) / 4
        loose = float(spread[np.ix_(group, group)].max()) if len(group) > 1 else np.inf
        off = float(distance[group].mean()) / body
        return whole * size / (1 + loose / FIRM) / (1 + (off / CENTRAL) ** 2)

    return fitness


def _mirror_by_names(labels: Sequence[str]) -> dict[str, str]:
    """Return mirror pairs told by L and R, l and r, left and right; else nothing.

    If half of the labels come in pairs, the others are taken for markers in the middle,
    except those that are named as of one side.
    """
    present = set(labels)
    pairs: dict[str, str] = {}
    one_sided: set[str] = set()
    for label in labels:
        others = _other_side(label)
        if others:
            one_sided.add(label)
        for other in others:
            if other in present:
                pairs[label] = other
    if 2 * len(pairs) < len(labels):
        return {}
    return {
        label: pairs.get(label, label)
        for label in labels
        if label in pairs or label not in one_sided
    }


def _other_side(label: str) -> list[str]:
    """Return what the mirror image of a marker could be called."""
    swap = {"L": "R", "R": "L", "l": "r", "r": "l"}
    words = {"left": "right", "Left": "Right", "LEFT": "RIGHT"}
    words |= {right: left for left, right in words.items()}
    others = [label.replace(a, b) for a, b in words.items() if a in label]
    if label[:1] in swap:
        others.append(swap[label[0]] + label[1:])
    if len(label) > 2 and label[-2] in "_.- " and label[-1] in swap:
        others.append(label[:-1] + swap[label[-1]])
    return others


def _folders() -> list[Path]:
    folders = []
    named = os.environ.get(ENV_FOLDER)
    if named:
        folder = Path(named)
        if not folder.is_dir():
            raise MarkerSetError(
                f"{folder}: is not a folder; set {ENV_FOLDER} to one with marker-set definitions"
            )
        folders.append(folder)
    config = os.environ.get("XDG_CONFIG_HOME")
    folder = (Path(config) if config else Path.home() / ".config") / "priorfill" / "markersets"
    if folder.is_dir():
        folders.append(folder)
    folders.append(shipped("markersets"))
    return folders


def _read(path: Path) -> MarkerSet:
    try:
        stamp = path.stat().st_mtime_ns
    except OSError as error:
        raise MarkerSetError(
            f"{path}: cannot be read ({error.strerror}); check the path of the definition"
        ) from error
    return _read_cached(path, stamp)


@lru_cache(maxsize=256)
def _read_cached(path: Path, stamp: int) -> MarkerSet:
    """Read a definition; `stamp` is its time of change, so that an edited file is read again."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise MarkerSetError(
            f"{path}: cannot be read ({error.strerror}); check the file's permissions"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        reason = str(error).splitlines()[0]
        raise MarkerSetError(f"{path}: is not valid TOML: {reason}; correct the file") from error
    return _parse(content, path)


def _parse(content: dict[str, Any], path: Path) -> MarkerSet:
    """Return the set that a definition's content makes, checked."""
    for key in sorted(set(content) - _KEYS):
        raise MarkerSetError(
            f"{path}: key {key} is unknown; use {', '.join(sorted(_KEYS))} (see README.md)"
        )
    name = _text(content, "name", path, required=True)
    if not _NAME.fullmatch(name):
        raise MarkerSetError(
            f"{path}: name {name!r} is unfit; use letters, digits, '-', '_' and '.'"
        )
    table = content.get("markers")
    if not isinstance(table, dict) or not table:
        raise MarkerSetError(f"{path}: has no markers; add a table [markers] of labels")
    segment: dict[str, str] = {}
    reliable: dict[str, bool] = {}
    optional: set[str] = set()
    for label, entry in table.items():
        if not isinstance(entry, dict) or not isinstance(entry.get("segment"), str):
            raise MarkerSetError(
                f"{path}: marker {label} has no segment; "
                f'write {label} = {{ segment = "...", reliable = true }}'
            )
        for key in sorted(set(entry) - _MARKER_KEYS):
            raise MarkerSetError(
                f"{path}: marker {label} has the unknown key {key}; "
                f"use {', '.join(sorted(_MARKER_KEYS))}"
            )
        for key in ("reliable", "optional"):
            if not isinstance(entry.get(key, False), bool):
                raise MarkerSetError(
                    f"{path}: marker {label} has {key} = {entry[key]!r}; write true or false"
                )
        segment[label] = entry["segment"]
        reliable[label] = entry.get("reliable", False)
        if entry.get("optional", False):
            optional.add(label)
    roots = _texts(content, "root_segments", path)
    for root in roots:
        if root not in segment.values():
            raise MarkerSetError(
                f"{path}: root segment {root} has no markers; "
                f"use some of {', '.join(sorted(set(segment.values())))}"
            )
    if not roots:
        raise MarkerSetError(
            f"{path}: has no root_segments; list the segments that can carry the root frame"
        )
    return MarkerSet(
        name=name,
        labels=tuple(segment),
        segment=segment,
        reliable=reliable,
        mirror=_parse_mirror(content, path, segment),
        root_segments=roots,
        title=_text(content, "title", path, required=True),
        source=_text(content, "source", path, required=False),
        aliases=_parse_aliases(content, path, segment),
        optional=frozenset(optional),
        joints=_parse_joints(content, path, segment),
    )


def _parse_mirror(content: dict[str, Any], path: Path, labels: Mapping[str, str]) -> dict[str, str]:
    rule = content.get("mirror", {})
    mirror: dict[str, str] = {}
    if rule == MIRROR_RULE:
        for label in labels:
            if label[0] == "L" and "R" + label[1:] in labels:
                mirror |= {label: "R" + label[1:], "R" + label[1:]: label}
    elif isinstance(rule, dict):
        for label, other in rule.items():
            for one in (label, other):
                _check_known(one, labels, "mirror", path)
            if mirror.get(label, other) != other or mirror.get(other, label) != label:
                raise MarkerSetError(
                    f"{path}: [mirror] gives {label} or {other} two mirror images; leave one"
                )
            mirror |= {label: other, other: label}
    else:
        raise MarkerSetError(
            f'{path}: mirror = {rule!r} is unknown; write mirror = "{MIRROR_RULE}" or a table'
        )
    for label in _texts(content, "midline", path):
        _check_known(label, labels, "midline", path)
        if mirror.get(label, label) != label:
            raise MarkerSetError(
                f"{path}: {label} is in midline but mirrors onto {mirror[label]}; leave one"
            )
        mirror[label] = label
    return mirror


def _parse_aliases(
    content: dict[str, Any], path: Path, labels: Mapping[str, str]
) -> dict[str, str]:
    table = content.get("aliases", {})
    if not isinstance(table, dict):
        raise MarkerSetError(f'{path}: aliases is no table; write [aliases] and LABEL = ["..."]')
    aliases: dict[str, str] = {}
    for label in table:
        _check_known(label, labels, "aliases", path)
        for alias in _texts(table, label, path):
            if alias in labels or aliases.get(alias, label) != label:
                raise MarkerSetError(
                    f"{path}: alias {alias} of {label} is another marker too; take it out"
                )
            aliases[alias] = label
    return aliases


def _parse_joints(
    content: dict[str, Any], path: Path, labels: Mapping[str, str]
) -> dict[str, Joint]:
    table = content.get("joints", {})
    if not isinstance(table, dict):
        raise MarkerSetError(
            f'{path}: joints is no table; write [joints] and NAME = [["..."], ["..."], ["..."]]'
        )
    joints: dict[str, Joint] = {}
    for name, points in table.items():
        lists = isinstance(points, list) and all(
            isinstance(point, list) and point and all(isinstance(m, str) for m in point)
            for point in points
        )
        if not lists or len(points) != JOINT_POINTS:
            raise MarkerSetError(
                f"{path}: joint {name} is not three lists of markers; "
                'write [["HIP"], ["KNEE"], ["ANKLE"]]'
            )
        for point in points:
            for label in point:
                _check_known(label, labels, "joints", path)
        joints[name] = cast(Joint, tuple(tuple(point) for point in points))
    return joints


def _check_known(label: object, labels: Mapping[str, str], where: str, path: Path) -> None:
    if label not in labels:
        raise MarkerSetError(
            f"{path}: {where} names {label}, which is not in [markers]; correct the label"
        )


def _text(content: dict[str, Any], key: str, path: Path, *, required: bool) -> str:
    value = content.get(key, "")
    if not isinstance(value, str) or (required and not value):
        raise MarkerSetError(f'{path}: has no {key}; write {key} = "..."')
    return value


def _texts(content: dict[str, Any], key: str, path: Path) -> tuple[str, ...]:
    value = content.get(key, [])
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise MarkerSetError(f'{path}: {key} is no list of names; write {key} = ["...", "..."]')
    return tuple(value)

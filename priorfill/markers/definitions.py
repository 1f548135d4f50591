"""Read marker-set definitions (TOML), and find the one that fits the labels of a clip."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

from priorfill.errors import MarkerSetError, OptionError
from priorfill.markers.marker_set import Joint, MarkerSet
from priorfill.runtime.option_texts import close_or_all
from priorfill.runtime.resources import resource_path
from priorfill.runtime.toml_file import read_toml

__all__ = ["available", "load", "recognise"]

MIN_SET_SHARE = 0.4
"""Fraction of a set's markers that a clip must have: the legs of a full-body set, 16 of 39 markers,
are enough."""

MIN_CLIP_SHARE = 0.6
"""Fraction of a clip's markers that a set must contain."""

ENV_FOLDER = "PRIORFILL_MARKERSETS"
"""Environment variable with the path of a folder of the user's definitions."""

JOINT_POINTS = 3
"""Points of a joint angle: above the joint, the joint, and below it."""

MIRROR_RULE = "L/R"
"""Mirror rule of definition files: labels L... and R... are mirror images."""

_KEYS = {
    *("name", "title", "source", "root_segments", "mirror", "midline", "markers", "aliases"),
    "joints",
}

_MARKER_KEYS = {"segment", "reliable", "optional"}

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def load(name_or_path: str | Path) -> MarkerSet:
    """Return a marker set by name, or read it from a definition file.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a marker set in `available`, or path of a ``.toml`` file.

    Returns
    -------
    MarkerSet

    Raises
    ------
    OptionError
        If there is no such set.
    MarkerSetError
        If its definition is malformed.

    See Also
    --------
    available : All marker sets.
    recognise : The one that fits a clip.

    Examples
    --------
    >>> load("plug-in-gait").segment["LKNE"]
    'left_thigh'
    """
    path = Path(name_or_path)
    if path.suffix.lower() == ".toml" or len(path.parts) > 1:
        return _read(path)
    sets = available()
    if str(name_or_path) not in sets:
        near = close_or_all(str(name_or_path), sorted(sets))
        raise OptionError(
            f"marker set {name_or_path} is unknown; {near} "
            "(or give the path of a definition, NAME.toml)"
        )
    return sets[str(name_or_path)]


def available() -> dict[str, MarkerSet]:
    """Return all marker sets by name. The user's take precedence over those of the package.

    Raises
    ------
    MarkerSetError
        If a definition is malformed, or the folder in `PRIORFILL_MARKERSETS` does not exist.

    Examples
    --------
    >>> "plug-in-gait" in available()
    True
    """
    sets: dict[str, MarkerSet] = {}
    for folder in _folders():
        here: dict[str, Path] = {}
        for path in sorted(folder.glob("*.toml")):
            marker_set = _read(path)
            if marker_set.name in here:
                raise MarkerSetError(
                    f"{path}: the name {marker_set.name} is also that of "
                    f"{here[marker_set.name].name}; choose another name"
                )
            here[marker_set.name] = path
            sets.setdefault(marker_set.name, marker_set)
    return sets


def recognise(labels: Sequence[str]) -> MarkerSet | None:
    """Return the marker set that fits the labels of a clip best.

    A set fits if it contains at least `MIN_CLIP_SHARE` of the clip's markers, and the clip at least
    `MIN_SET_SHARE` of the set's markers that are not optional. The best one has the largest Dice
    coefficient.

    Parameters
    ----------
    labels : sequence of str
        The clip's labels without subject prefix.

    Returns
    -------
    MarkerSet or None
        The complete definition; None if no set fits.

    Raises
    ------
    MarkerSetError
        If a definition file is malformed.

    Examples
    --------
    >>> recognise(["anything", "else"]) is None
    True
    """
    best: MarkerSet | None = None
    best_score = 0.0
    for _, marker_set in sorted(available().items()):
        match = marker_set.match(labels)
        needed = [label for label in marker_set.labels if label not in marker_set.optional]
        found = sum(label not in marker_set.optional for label in match.values())
        if found < MIN_SET_SHARE * len(needed) or len(match) < MIN_CLIP_SHARE * len(labels):
            continue
        score = 2 * found / (len(needed) + len(labels))
        if score > best_score:
            best, best_score = marker_set, score
    return best


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
    users = _users_folder()
    if users is not None:
        folders.append(users)
    folders.append(resource_path("markersets"))
    return folders


def _users_folder() -> Path | None:
    """Return the folder of the user's own definitions, if there is one that may be read."""
    config = os.environ.get("XDG_CONFIG_HOME")
    try:
        folder = (Path(config) if config else Path.home() / ".config") / "priorfill" / "markersets"
        return folder if folder.is_dir() else None
    except (OSError, RuntimeError):  # a home of another user, or none
        return None


def _read(path: Path) -> MarkerSet:
    try:
        stamp = path.stat().st_mtime_ns
    except (FileNotFoundError, NotADirectoryError):
        raise OptionError(f"{path}: there is no such marker set; check the path") from None
    except OSError as error:
        raise MarkerSetError(
            f"{path}: cannot be read ({error.strerror}); check the path of the definition"
        ) from error
    return _read_cached(path, stamp)


@lru_cache(maxsize=256)
def _read_cached(path: Path, stamp: int) -> MarkerSet:
    """Read a definition. ``stamp``, its modification time, makes edited files be read again."""
    return _parse(read_toml(path, MarkerSetError), path)


def _parse(content: dict[str, Any], path: Path) -> MarkerSet:
    """Return the marker set that a definition describes, after checking it."""
    for key in sorted(set(content) - _KEYS):
        raise MarkerSetError(
            f"{path}: key {key} is unknown; use {', '.join(sorted(_KEYS))} (see README.md)"
        )
    name = _text(content, "name", path, required=True)
    if not _NAME.fullmatch(name):
        raise MarkerSetError(
            f"{path}: name {name!r} is not allowed; use letters, digits, '-', '_' and '.'"
        )
    segment, reliable, optional = _parse_markers(content, path)
    roots = _texts(content, "root_segments", path)
    for root in roots:
        if root not in segment.values():
            raise MarkerSetError(
                f"{path}: root segment {root} has no markers; "
                f"use some of {', '.join(sorted(set(segment.values())))}"
            )
    if not roots:
        raise MarkerSetError(
            f"{path}: has no root_segments; list the segments that can define the root frame"
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


def _parse_markers(
    content: dict[str, Any], path: Path
) -> tuple[dict[str, str], dict[str, bool], set[str]]:
    """Return segment and reliability of each marker, and the optional markers."""
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
    return segment, reliable, optional


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
                    f"{path}: [mirror] gives {label} or {other} two mirror images; keep one"
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
                f"{path}: {label} is in midline but mirrors onto {mirror[label]}; keep one"
            )
        mirror[label] = label
    return mirror


def _parse_aliases(
    content: dict[str, Any], path: Path, labels: Mapping[str, str]
) -> dict[str, str]:
    table = content.get("aliases", {})
    if not isinstance(table, dict):
        raise MarkerSetError(f'{path}: aliases is not a table; write [aliases] and LABEL = ["..."]')
    aliases: dict[str, str] = {}
    for label in table:
        _check_known(label, labels, "aliases", path)
        for alias in _texts(table, label, path):
            if alias in labels or aliases.get(alias, label) != label:
                raise MarkerSetError(
                    f"{path}: alias {alias} of {label} is also another marker; remove it"
                )
            aliases[alias] = label
    return aliases


def _parse_joints(
    content: dict[str, Any], path: Path, labels: Mapping[str, str]
) -> dict[str, Joint]:
    table = content.get("joints", {})
    if not isinstance(table, dict):
        raise MarkerSetError(
            f'{path}: joints is not a table; write [joints] and NAME = [["..."], ["..."], ["..."]]'
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
        raise MarkerSetError(f'{path}: {key} is not a list of names; write {key} = ["...", "..."]')
    return tuple(value)

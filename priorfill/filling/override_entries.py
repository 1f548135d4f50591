"""Overrides as entries: mappings with the keys of a file of overrides, checked and written."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from reprlib import Repr
from typing import TYPE_CHECKING, Any

from priorfill.errors import OptionError
from priorfill.methods import ALIASES, METHODS
from priorfill.runtime.option_texts import close_or_all, parse_frames, parse_names

if TYPE_CHECKING:
    from priorfill.filling.overrides import GapOverride

__all__ = [
    "ACCEPT",
    "ACTIONS",
    "CLIP",
    "DATABASE",
    "LEAVE",
    "MISSING",
    "SAME_SUBJECT",
    "SWAP",
    "check_entry",
    "entry_fields",
    "entry_of",
    "flat_options",
    "shown_value",
    "unknown_marker",
]

ACCEPT, LEAVE, MISSING, SWAP = "accept", "leave", "missing", "swap"
"""Actions other than a method: fill as without the override; leave a gap missing; treat measured
samples as missing; exchange the measured samples of two markers."""

ACTIONS = (ACCEPT, LEAVE, MISSING, SWAP)

CLIP, SAME_SUBJECT, DATABASE = "clip", "same-subject", "database"
"""Sources: the clip's own frames, other recordings of the same subject, and the database, all of
it or, as ``database:PATTERN``, the clips whose names match a shell pattern."""

_KEYS = ("marker", "frames", "do", "with", "donors", "sources", "options", "subject", "note")

MAX_DEPTH = 8
"""Tables within each other that options may have; those of methods have three."""

_MAX_SHOWN = 60
"""Characters of a wrong value in a message."""

_REPR = Repr()
"""Of values of any size and depth."""
_REPR.maxlevel, _REPR.maxstring, _REPR.maxother = 3, _MAX_SHOWN, _MAX_SHOWN


def entry_fields(entry: Any, where: str) -> dict[str, Any]:
    """Return the fields of a `GapOverride` that an entry describes.

    Parameters
    ----------
    entry : mapping
        With the keys of a file of overrides.
    where : str
        The entry, the start of messages.

    Raises
    ------
    OptionError
        Where a key is unknown, a value is of another type or out of range, or keys contradict
        each other.
    """
    if not isinstance(entry, Mapping):
        raise OptionError(f"{where}: is {shown_value(entry)}; give a table of {', '.join(_KEYS)}")
    unknown = [key for key in entry if key not in _KEYS]
    if unknown:
        raise OptionError(f"{where}: unknown key {shown_value(unknown[0])}; use {', '.join(_KEYS)}")
    do = entry.get("do")
    actions = (*ACTIONS, "auto", *METHODS)
    if not isinstance(do, str) or do not in (*actions, *ALIASES):
        wrong = f"do is {shown_value(do)}" if "do" in entry else "has no do"
        raise OptionError(f"{where}: {wrong}; {close_or_all(_short(str(do)), actions)}")
    markers = _names(entry.get("marker", ()), "marker", where)
    if not markers:
        raise OptionError(f"{where}: has no marker; give a label, a pattern, or a list of these")
    first, last = _frames(entry.get("frames", ":"), where)
    options = entry.get("options", {})
    if not isinstance(options, Mapping):
        raise OptionError(f"{where}: options is {shown_value(options)}; write {{ name = value }}")
    fields = {
        "markers": markers,
        "do": do,
        "first": first,
        "last": last,
        "subject": _text(entry, "subject", where),
        "other": _text(entry, "with", where),
        "donors": _names(entry.get("donors", ()), "donors", where),
        "sources": _names(entry.get("sources", ()), "sources", where),
        "options": options,
        "note": _text(entry, "note", where),
    }
    for key in ("donors", "sources"):
        if key in entry and not fields[key]:
            raise OptionError(f"{where}: {key} is empty; name some, or leave it out for all")
    try:
        fields["options"] = flat_options(options)
        _check_fields(fields, is_method=do not in ACTIONS)
    except OptionError as error:
        raise OptionError(f"{where}: {error}") from None
    return fields


def entry_of(override: GapOverride) -> dict[str, Any]:
    """Return an override as a dictionary with the keys of a file of overrides.

    Parameters
    ----------
    override : GapOverride
        The override.

    Returns
    -------
    dict
        Of texts, numbers, truth values, lists and dictionaries. Keys at their defaults are left
        out.
    """
    entry: dict[str, Any] = {"marker": _as_names(override.markers)}
    if override.first is not None and override.first == override.last:
        entry["frames"] = override.first
    elif override.first is not None or override.last is not None:
        # with a colon, which does not look like a sign
        ends = ["" if end is None else str(end) for end in (override.first, override.last)]
        sign = ":" if "" in ends or any(end.startswith("-") for end in ends) else "-"
        entry["frames"] = sign.join(ends)
    if override.subject:
        entry["subject"] = override.subject
    entry["do"] = override.do
    if override.other:
        entry["with"] = override.other
    for key, names in (("donors", override.donors), ("sources", override.sources)):
        if names:
            entry[key] = list(names)
    if override.options:
        entry["options"] = {name: _as_plain(value) for name, value in override.options.items()}
    if override.note:
        entry["note"] = override.note
    return entry


def check_entry(override: GapOverride) -> None:
    """Raise OptionError where fields of an override do not apply to its action.

    Parameters
    ----------
    override : GapOverride
        The override.
    """
    if not override.markers:
        raise OptionError("an override has no marker; give a label or a pattern")
    names = ("markers", "do", "other", "donors", "sources", "options")
    _check_fields({name: getattr(override, name) for name in names}, override.is_method)


def flat_options(
    options: Mapping[str, Any], prefix: str = "", depth: int = MAX_DEPTH
) -> dict[str, Any]:
    """Return options of a method by dotted name.

    Parameters
    ----------
    options : mapping of str to object
        By dotted name, or, as TOML reads ``training.max_poses = 300``, in mappings within it.
    prefix : str
        What precedes the names.
    depth : int
        Mappings within each other at most.

    Raises
    ------
    OptionError
        Where an option is given twice, or a value is of a type that no option has.
    """
    flat: dict[str, Any] = {}
    for name, value in options.items():
        path = f"{prefix}{name}"
        if isinstance(value, Mapping) and depth > 1:
            found = flat_options(value, f"{path}.", depth - 1)
        elif _is_value(value):
            found = {path: tuple(value) if isinstance(value, list) else value}
        else:
            raise OptionError(
                f"option {_short(path)} is {shown_value(value)}; give a number, a text, true, "
                "false or a list of these"
            )
        twice = [one for one in found if one in flat]
        if twice:
            raise OptionError(f"option {_short(twice[0])} is given twice; remove one")
        flat |= found
    return flat


def _check_fields(fields: Mapping[str, Any], is_method: bool) -> None:
    """Raise OptionError where fields do not apply to an action, or are out of range."""
    do = fields["do"]
    for name in ("donors", "sources", "options"):
        if fields[name] and not is_method:
            raise OptionError(f"{name} applies to a method, not to {do}; remove it")
    if (do == SWAP) != bool(fields["other"]):
        raise OptionError(
            "swap needs the other marker; give it as `with`"
            if do == SWAP
            else f"`with` applies to swap, not to {do}; remove it"
        )
    if do == SWAP and len(fields["markers"]) != 1:
        raise OptionError("swap exchanges two markers; write an entry for each pair")
    for source in fields["sources"]:
        kind, colon, pattern = source.partition(":")
        if source not in (CLIP, SAME_SUBJECT, DATABASE) and not (
            kind == DATABASE and colon and pattern
        ):
            known = (CLIP, SAME_SUBJECT, DATABASE, f"{DATABASE}:PATTERN")
            raise OptionError(
                f"there is no source {shown_value(source)}; {close_or_all(source, known)}"
            )


def _names(value: Any, key: str, where: str) -> tuple[str, ...]:
    """Read a name, several separated by commas, or a list of names."""
    if isinstance(value, str):
        try:
            return parse_names(value)
        except OptionError:
            return ()
    if isinstance(value, (list, tuple)) and all(isinstance(one, str) for one in value):
        return tuple(dict.fromkeys(value))
    raise OptionError(f"{where}: {key} is {shown_value(value)}; give a text or a list of texts")


def _as_names(names: tuple[str, ...]) -> str | list[str]:
    """Return names as `_names` reads them: one alone as a text, unless that reads differently."""
    alone = len(names) == 1 and names[0].strip() and parse_names(names[0]) == names
    return names[0] if alone else list(names)


def _text(entry: Mapping[str, Any], key: str, where: str) -> str:
    """Read a text; empty by default."""
    value = entry.get(key, "")
    if not isinstance(value, str):
        raise OptionError(f"{where}: {key} is {shown_value(value)}; give a text")
    return value


def _frames(value: Any, where: str) -> tuple[int | None, int | None]:
    """Read a number, or a text as `parse_frames` does."""
    if type(value) is int:
        return value, value
    try:
        return parse_frames(_short(value if isinstance(value, str) else repr(value)))
    except OptionError as error:
        raise OptionError(f"{where}: {error}") from None


def _is_value(value: Any) -> bool:
    """Whether a value is of a type that options of methods have."""
    if isinstance(value, (list, tuple)):
        return all(_is_value(one) and not isinstance(one, (list, tuple)) for one in value)
    return value is None or isinstance(value, (bool, int, float, str))


def _as_plain(value: Any) -> Any:
    """Return a value of an option as TOML and JSON have it."""
    if value is None:
        return "none"
    return list(value) if isinstance(value, tuple) else value


def _short(text: str) -> str:
    """Return a text as far as a message has room."""
    return text if len(text) <= _MAX_SHOWN else f"{text[:_MAX_SHOWN]}..."


def shown_value(value: Any) -> str:
    """Return a wrong value as far as a message has room.

    Parameters
    ----------
    value : object
        Of any type, size and depth.
    """
    return _short(_REPR.repr(value))


def unknown_marker(where: str, pattern: str, whose: str, labels: Iterable[str]) -> OptionError:
    """Return the error for a pattern that matches no marker.

    Parameters
    ----------
    where : str
        The entry, the start of the message.
    pattern : str
        The pattern.
    whose : str
        The clip whose markers were searched.
    labels : iterable of str
        The labels of these markers.
    """
    return OptionError(
        f"{where}: no marker of {whose} is called {shown_value(pattern)}; "
        f"{close_or_all(pattern, list(dict.fromkeys(labels)))}"
    )
